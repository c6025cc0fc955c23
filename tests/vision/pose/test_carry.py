"""Finding a target again after a shake, in light that hides it from other eyes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import LightConditions
from tests.vision.views import VGA, View, place, shipped

DIM = replace(LightConditions(), exposure=0.06, noise_sd=2.5)
BLURRED = replace(LightConditions(), defocus_px=5.0)


def pose_of(view: View) -> Pose:
    return Pose(view.rotation, view.position, np.eye(6), "edges", 99, 0.1)


def shaken(view: View, target, conditions) -> View:
    """The same place, the camera turned by one and a half degrees."""
    turned = turn(view.view.enu_from_cam, np.radians([1.0, -1.1, 0.4]))
    return View(target, replace(view.view, enu_from_cam=turned), conditions)


def miss_px(carried: Pose, true: View, target) -> float:
    corners = target.tags[0].corners
    projection = Projection(VGA)
    seen, _ = projection.project(corners @ carried.rotation.T + carried.position)
    truth, _ = projection.project(corners @ true.rotation.T + true.position)
    return float(np.abs(seen - truth).max())


@pytest.mark.parametrize("conditions", [None, DIM, BLURRED], ids=["bright", "dim", "blurred"])
@pytest.mark.parametrize("distance", [1.0, 4.0])
def test_the_whole_image_of_a_target_is_found_again(distance, conditions):
    target = shipped("nested")
    before = View(target, place(distance, 0.2))
    after = shaken(before, target, conditions)
    carried = TargetFitter(target, Projection(VGA)).carried(before.pixels, after.pixels, pose_of(before))
    assert carried is not None
    assert miss_px(carried, after, target) < 0.1 * VGA.fx * target.tags[0].size / distance


def test_what_is_not_there_is_not_found():
    target = shipped("nested")
    before = View(target, place(3.0, 0.2))
    empty = View(target, place(3.0, 0.2), replace(LightConditions(), target_in_view=False))
    fitter = TargetFitter(target, Projection(VGA))
    assert fitter.carried(before.pixels, empty.pixels, pose_of(before)) is None
    outside = replace(pose_of(before), position=np.array([9.0, 0.0, 1.0]))
    assert fitter.carried(before.pixels, empty.pixels, outside) is None
