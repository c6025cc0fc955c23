"""A tilt is held where something may lie over the target, not where all of its edges contradict the attitude."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.config.vision import TrackerSection
from mkdaemon.frames import rotation_from_euler
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.track.attitude import LOOKING_DOWN
from mkdaemon.vision.track.checks import Checks
from mkdaemon.vision.track.judge import Judge, Verdict
from mkdaemon.vision.track.level import Sight
from mkdaemon.vision.track.track import Track
from tests.vision.views import VGA, View, place, shipped

KNOWN = 30
"""Images that told the tilt."""


def judged(name: str, off_deg: float) -> Verdict:
    """Verdict about a far target in full view whose tilt is known, beside an attitude that is off by so much since."""
    view = View(shipped(name), place(3.8, 0.25))
    right = view.view.enu_from_cam @ LOOKING_DOWN.flu_from_cam.T
    track, truth = Track(), Pose(view.rotation, view.position, 1e-6 * np.eye(6), "edges", 200, 0.05)
    checks = Checks(TargetFitter(shipped(name), Projection(VGA)), track, TrackerSection(), LOOKING_DOWN)
    for k in range(KNOWN):
        checks.level.learn(Sight(view.pixels, k / 30, right), truth)
    now = KNOWN / 30
    off = right @ rotation_from_euler(np.radians(off_deg), 0.0, 0.0)
    track.accept(now - 1 / 30, truth, off, view.pixels)
    return Judge(checks).measure(Sight(view.pixels, now, off), truth, truth)


@pytest.mark.parametrize("name", ["single", "nested"])
@pytest.mark.parametrize("off_deg", [7.0, -7.0, 10.0])
def test_an_attitude_that_a_whole_target_contradicts_is_not_held(name: str, off_deg: float) -> None:
    verdict = judged(name, off_deg)
    assert verdict.pose is None
    assert verdict.refusal is PoseRefusal.ATTITUDE


@pytest.mark.parametrize("name", ["single", "nested"])
def test_a_whole_target_that_agrees_is_posed(name: str) -> None:
    verdict = judged(name, 1.0)
    assert verdict.pose is not None
    assert verdict.refusal is None
