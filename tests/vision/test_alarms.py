"""Images that are no use are named before anything looks at them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.sim.scene import Scene, SceneTarget, true_corners
from mkdaemon.sim.scene_light import Conditions
from mkdaemon.sim.scene_motion import Platform
from mkdaemon.sim.scene_view import view_towards
from mkdaemon.vision.alarms import FROZEN_IMAGES, ImageJudge, ImageState, edge_width
from mkdaemon.vision.intrinsics import Intrinsics
from mkdaemon.vision.tagmap import single

VGA = Intrinsics(width=640, height=480, fx=600, fy=600, cx=319.5, cy=239.5)
PAD = SceneTarget.of(single(0.3048, 48), Platform())
VIEW = view_towards(VGA, np.array([0.1, 0.2, 1.2]), np.zeros(3))
SCENE = Scene([PAD], seed=8, fine=False)


def shot(**change: float) -> np.ndarray:
    return SCENE.render(VIEW, replace(Conditions(), **change))


@pytest.mark.parametrize(
    ("image", "state", "alarms"),
    [
        (shot(), ImageState.OK, ()),
        (shot(exposure=0.06), ImageState.OK, ("dark",)),
        (shot(noise_sd=40.0), ImageState.OK, ()),
        (shot(exposure=1e-4), ImageState.BLACK, ("dark",)),
        (np.zeros((480, 640), np.uint8), ImageState.BLACK, ("dark",)),
        (np.full((480, 640), 255, np.uint8), ImageState.BLOWN, ("blown",)),
        (shot(exposure=30.0), ImageState.BLOWN, ("blown",)),
        (np.full((720, 1280), 128, np.uint8), ImageState.WRONG_SIZE, ()),
    ],
)
def test_states(image: np.ndarray, state: ImageState, alarms: tuple[str, ...]) -> None:
    verdict = ImageJudge(VGA).judge(image)
    assert (verdict.state, verdict.alarms) == (state, alarms)
    assert bool(verdict.reason) is (state is not ImageState.OK)


def test_a_wrong_size_names_both_sizes() -> None:
    reason = ImageJudge(VGA).judge(np.full((720, 1280), 128, np.uint8)).reason
    assert "1280x720" in reason
    assert "640x480" in reason


def test_without_a_calibration_any_size_will_do() -> None:
    assert ImageJudge(None).judge(shot()[:100, :100]).state is ImageState.OK


def test_equal_images_are_a_frozen_camera_unless_they_come_from_a_file() -> None:
    image, fresh = shot(), shot()
    judge, player = ImageJudge(VGA), ImageJudge(VGA, live=False)
    states = [judge.judge(image).state for _ in range(FROZEN_IMAGES + 1)]
    assert states == [ImageState.OK] * (FROZEN_IMAGES - 1) + [ImageState.FROZEN] * 2
    assert judge.judge(fresh).state is ImageState.OK
    assert {player.judge(image).state for _ in range(FROZEN_IMAGES + 1)} == {ImageState.OK}


def test_blur_widens_edges() -> None:
    corners = true_corners(PAD, VIEW)["tag36h11", 48]
    widths = [edge_width(shot(defocus_px=px), corners) for px in (0.0, 6.0, 12.0)]
    assert widths[0] < 4.5
    assert widths[0] < widths[1] < widths[2]
    assert widths[2] > 8.0
    assert edge_width(shot(), np.array([[-40.0, -40], [-30, -40], [-30, -30], [-40, -30]])) == 0.0
