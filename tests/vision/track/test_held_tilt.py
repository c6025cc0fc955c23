"""A tilt is held where something may lie over the target, not where all of its edges contradict the attitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.vision import TrackerSection
from mkdaemon.frames import rotation_from_euler
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import TargetLevel
from mkdaemon.vision.track.attitude import ImageSight, fuse_normal
from mkdaemon.vision.track.branches import Branches
from mkdaemon.vision.track.judge import FitVerdict, Judge
from mkdaemon.vision.track.level import LevelKnowledge
from tests.vision.views import VGA, View, angle_deg, nearly, place, shipped

KNOWN = 30
"""Images that told the tilt."""


def judge_of(name: str) -> Judge:
    """Judge of a target over a level place."""
    fitter = TargetFitter(shipped(name), Projection(VGA))
    return Judge(fitter, LevelKnowledge(True, LOOKING_DOWN, TrackerSection()), TrackerSection())


def judged(name: str, off_deg: float) -> FitVerdict:
    """Verdict about a far target in full view whose tilt is known, beside an attitude that is off by so much since."""
    view = View(shipped(name), place(3.8, 0.25))
    right = view.view.enu_from_cam
    truth = Pose(view.rotation, view.position, 1e-6 * np.eye(6), "edges", 200, 0.05)
    judge = judge_of(name)
    for k in range(KNOWN):
        judge.level.learn(ImageSight(view.pixels, k / 30, right), truth)
    now = KNOWN / 30
    flu_from_cam = LOOKING_DOWN.flu_from_cam
    off = right @ flu_from_cam.T @ rotation_from_euler(np.radians(off_deg), 0.0, 0.0) @ flu_from_cam
    return judge.measure(ImageSight(view.pixels, now, off), truth)


@pytest.mark.parametrize("name", ["single", "nested"])
@pytest.mark.parametrize("off_deg", [7.0, -7.0, 10.0])
def test_an_attitude_that_a_whole_target_contradicts_is_not_held(name: str, off_deg: float) -> None:
    verdict = judged(name, off_deg)
    assert verdict.contradicts
    assert verdict.refusal is PoseRefusal.ATTITUDE


def test_what_the_image_cannot_tell_inertia_does() -> None:
    """A tilt held to an attitude that jumps by 6 degrees was published once in some thousand images after the jump."""
    view, judge = View(shipped("nested"), place(3.8, 0.25)), judge_of("nested")
    right = Pose(view.rotation, view.position, 1e-6 * np.eye(6), "edges", 200, 0.05, loss=1.0)
    leaning = replace(right, rotation=turn(view.rotation, np.radians([6.0, 0.0, 0.0])))
    seen = ImageSight(view.pixels, KNOWN / 30)
    assert not judge.prefers(seen, right, leaning, None)
    before = Branches.begin(0.0, [right])
    for k in range(1, KNOWN):
        before = before.after(k / 30, [right])
    assert judge.prefers(seen, right, leaning, before)
    assert not judge.prefers(seen, leaning, right, before)


@pytest.mark.parametrize("name", ["single", "nested"])
def test_a_whole_target_that_agrees_is_posed(name: str) -> None:
    verdict = judged(name, 1.0)
    assert verdict.pose is not None
    assert verdict.refusal is None


@pytest.mark.parametrize(("name", "distance"), [("single", 3.0), ("single", 4.0), ("nested", 3.5)])
@pytest.mark.parametrize("off_deg", [0.0, 0.8])
def test_a_tilt_that_a_fit_is_told_counts_as_much_as_it_is_known(name: str, distance: float, off_deg: float) -> None:
    """A fit that is told a normal ends where a free one ends that hears of it afterwards, and is as certain."""
    view = View(shipped(name), place(distance, 0.5))
    spread = np.radians(0.6)
    up = turn(view.rotation, np.radians([off_deg, 0.0, 0.0]))[:, 2]
    fit = EdgeFit(shipped(name), Projection(VGA))
    free, told = fit.fit(view.pixels, nearly(view)), fit.fit(view.pixels, nearly(view), level=TargetLevel(up, spread))
    assert free is not None
    fused = fuse_normal(free, TargetLevel(up, spread))
    assert np.linalg.norm(told.position - fused.position) < 0.6 * np.sqrt(np.trace(fused.covariance[:3, :3]))
    assert angle_deg(told.rotation, fused.rotation) < 0.6 * np.degrees(np.sqrt(np.trace(fused.covariance[3:, 3:])))
    assert np.trace(told.covariance[3:, 3:]) > 0.5 * np.trace(fused.covariance[3:, 3:])
