"""Images that are no use are named; rendered where a scene matters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.tags.tagmap import single
from mkdaemon.vision.track.tracker import ImageHealth
from mksim.scene.light import LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import view_towards

VGA = Intrinsics(width=640, height=480, fx=600, fy=600, cx=319.5, cy=239.5)
PAD = SceneTarget.of(single(0.3048, 48), Platform())
VIEW = view_towards(VGA, np.array([0.1, 0.2, 1.2]), np.zeros(3))


@cache
def scene() -> Scene:
    return Scene([PAD], ground=None, seed=3, fine=False)


def shot(**change: float) -> np.ndarray:
    return scene().render(VIEW, replace(LightConditions(), **change))


@pytest.mark.parametrize(
    ("image", "alarms"),
    [
        (shot, []),
        (partial(shot, exposure=0.06), ["dark"]),
        (partial(shot, noise_sd=40.0), []),
        (partial(np.zeros, (480, 640), np.uint8), ["dark"]),
        (partial(np.full, (480, 640), 255, np.uint8), ["blown"]),
        (partial(shot, exposure=30.0), ["blown"]),
        (partial(np.full, (720, 1280), 128, np.uint8), ["wrong_size"]),
        (partial(np.zeros, (0, 0), np.uint8), ["wrong_size"]),
    ],
)
def test_one_image(image: Callable[[], np.ndarray], alarms: list[str]) -> None:
    assert ImageHealth(VGA).check(image()) == alarms


def test_equal_images_are_a_frozen_camera() -> None:
    image, fresh = shot(), shot()
    health = ImageHealth(VGA)
    frozen = ["frozen" in health.check(image) for _ in range(LIMITS.health.frozen_images + 2)]
    assert frozen == [False] * LIMITS.health.frozen_images + [True] * 2
    assert "frozen" not in health.check(fresh)


def test_a_covered_lens_is_dark_and_not_frozen() -> None:
    health = ImageHealth(VGA)
    for _ in range(LIMITS.health.frozen_images + 3):
        assert health.check(np.zeros((480, 640), np.uint8)) == ["dark"]


@pytest.mark.parametrize(
    ("source", "blur_px", "side_px", "alarms"),
    [
        ("edges", 5.5, 80.0, ["blurred"]),
        ("edges", 4.0, 80.0, []),
        # Edges that melted are measured by grey values, which know the deviation of the point spread.
        ("photometric", 2.5, 80.0, ["blurred"]),
        ("photometric", 1.5, 80.0, []),
        ("photometric", 2.5, 40.0, []),
    ],
)
def test_images_without_focus_are_told_however_they_were_measured(source, blur_px, side_px, alarms) -> None:
    health = ImageHealth(VGA)
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]), np.eye(6), source, 200, 0.05, blur_px=blur_px)
    for _ in range(30):
        health.note(pose, side_px)
    assert health.check(shot()) == alarms
