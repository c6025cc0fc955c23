"""What the model of a print looks like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.prints import Prints
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import Target, load
from tests.places import CONFIGS

CAMERA = load_camera(CONFIGS / "cameras" / "sim.toml")
ABOVE = np.diag([1.0, -1.0, -1.0])


def white_of(target: Target, distance: float) -> float:
    """White in the image of a print, seen from above [m^2]."""
    projection = Projection(CAMERA.intrinsics)
    model = Prints(target, projection, LIMITS).all[0]
    rendered = model.render((480, 640), ABOVE, np.array([0.01, 0.02, distance]), 0.2 * np.eye(2))
    assert rendered is not None
    value = rendered.samples(np.zeros((480, 640), dtype=np.uint8)).value
    return float(value.sum()) * (distance / projection.focal[0]) ** 2


@pytest.mark.parametrize("distance", [5.0, 6.0, 7.0, 8.0])
def test_an_inner_tag_has_as_much_white_from_afar_as_its_cells(distance: float) -> None:
    target = load([CONFIGS / "targets" / "nested.toml"]).targets[0]
    outer, inner = target.tags
    cells = np.pad(inner.bitmap, 1, constant_values=255) / 255
    # The inner tag lies on black cells.
    added = white_of(target, distance) - white_of(replace(target, tags=(outer,)), distance)
    assert added == pytest.approx(inner.module**2 * cells.sum(), rel=0.02)
