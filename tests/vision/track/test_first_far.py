"""A far target in its first image, without attitude: the image tells it from its mirror image."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import ImageSight
from mkdaemon.vision.track.judge import Judge
from mkdaemon.vision.track.level import LevelKnowledge
from mkdaemon.vision.track.tracker import Tracker
from tests.vision.views import VGA, View, angle_deg, place, shipped

HD = Intrinsics(width=1280, height=720, fx=1200.0, fy=1200.0, cx=639.5, cy=359.5, line_time=0.0)


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
    assert found.decided_by == "image"
    assert angle_deg(found.pose.rotation, view.rotation) < 1.0
    assert np.linalg.norm(found.pose.position - view.position) < 0.01 * distance


def test_a_fit_that_ended_between_both_readings_is_asked_for_another() -> None:
    """Nearly head on, on the saddle between a target tilted by a few degrees and its mirror image."""
    view = View(shipped("single"), place(7.0, np.radians(4.0)))
    fitter = TargetFitter(shipped("single"), Projection(VGA))
    axis = np.cross(view.rotation[:, 2], -view.position)
    beyond = cv2.Rodrigues(np.radians(6.4) * axis / np.linalg.norm(axis))[0] @ view.rotation
    saddle = fitter.refine(view.pixels, Pose(beyond, view.position, 1e-6 * np.eye(6), "photometric", 800, 0.05))
    assert np.degrees(saddle.tilt) < 2.5
    assert angle_deg(saddle.rotation, view.rotation) > 4.0
    cfg = TrackerSection()
    judge = Judge(fitter, LevelKnowledge(True, LOOKING_DOWN, cfg), cfg)
    rivals = judge.candidates(ImageSight(view.pixels, 0.0), [saddle])
    best = min(rivals, key=lambda rival: rival.loss)
    assert angle_deg(best.rotation, view.rotation) < 1.0
