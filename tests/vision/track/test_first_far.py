"""A far target in its first image, without attitude: the image tells it from its mirror image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.tracker import Tracker
from tests.vision.views import VGA, View, angle_deg, place, shipped

HD = Intrinsics(width=1280, height=720, fx=1200.0, fy=1200.0, cx=639.5, cy=359.5)


@pytest.mark.parametrize(
    ("name", "lens", "distance", "tilt"),
    [
        ("single", HD, 8.0, 0.15),  # both readings fitted to edges, told apart by all pixels
        ("single", HD, 9.0, 0.4),
        ("nested", VGA, 8.0, 0.4),
        ("nested", VGA, 8.0, 0.6),
    ],
)
def test_the_first_image_decides(name: str, lens: Intrinsics, distance: float, tilt: float) -> None:
    target = shipped(name)
    view = View(target, replace(place(distance, tilt), intrinsics=lens))
    found = Tracker(TagMap((target,)), lens, None).update(view.image()).pose_of("pad")
    assert found is not None
    assert found.decided_by == "image"
    assert angle_deg(found.pose.rotation, view.rotation) < 1.0
    assert np.linalg.norm(found.pose.position - view.position) < 0.01 * distance
