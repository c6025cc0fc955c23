"""A tag of which something lies over a whole side: three borders in view, and a fourth that nobody sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.tags.detector import Detector
from mksim.scene.light import Cover, LightConditions
from tests.vision.views import View, place, shipped

TARGET = shipped("single")
(TAG,) = TARGET.tags
DETECTOR = Detector({TAG.family.name: frozenset({TAG.tag_id})})
HALF = TAG.size / 2


def shoe(reaches: float, reflectance: float, quarters: int) -> Cover:
    """Something longer than a side, with a round and slanting end that reaches so far over the tag, share of it."""
    across = np.linspace(-1.0, 1.0, 15)
    toe = HALF - reaches * TAG.size + 0.2 * TAG.size * (1.0 - np.sqrt(1.0 - across**2)) + 0.03 * TAG.size * across
    outline = np.array([*np.column_stack([0.65 * TAG.size * across, toe]), *(TAG.size * np.array([[1, 2], [-1, 2]]))])
    c, s = np.cos(quarters * np.pi / 2), np.sin(quarters * np.pi / 2)
    turned = outline @ np.array([[c, s], [-s, c]])
    return Cover(tuple((float(x), float(y)) for x, y in turned), reflectance)


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize(("distance", "reflectance"), [(1.7, 0.06), (2.8, 0.35), (4.0, 0.15)])
def test_three_borders_in_view_are_a_start(distance: float, reflectance: float, quarters: int) -> None:
    """Nothing was decoded from 4.3 to 1.7 m: a fourth side was only looked for in highlights."""
    covered = replace(LightConditions(), covers=(shoe(0.15, reflectance, quarters),))
    view = View(TARGET, place(distance, 0.3), covered)
    (found,) = DETECTOR.search(view.pixels, "outline")
    corners = view.corners[TAG.code]
    off = np.linalg.norm(found.corners - corners, axis=1).max() / (found.side_px / TAG.family.black_cells)
    assert off < 0.6  # cells; the fit to edges begins within half of one or so
