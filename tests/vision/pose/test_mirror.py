"""The mirror image of a pose is measured as the pose was: losses compare only between fits of one kind."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.ambiguity import log_odds
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from tests.vision.views import VGA, View, angle_deg, nearly, place, shipped

DECIDED = LIMITS.ambiguity.decided


@pytest.mark.parametrize(
    ("distance", "source"), [(5.0, "photometric"), (4.3, "photometric"), (4.3, "edges"), (3.7, "edges")]
)
def test_the_mirror_image_is_fitted_as_the_pose(distance, source):
    """Near the size of a cell that asks for the other kind of fit, a rival would be lost, and its absence count."""
    target = shipped("nested")
    view, fitter = View(target, place(distance, 0.2)), TargetFitter(target, Projection(VGA))
    truth = Pose(view.rotation, view.position, 1e-6 * np.eye(6), "edges", 200, 0.05)
    pose = truth if source == "edges" else fitter.fit_grey_values(view.pixels, [truth])[0]
    rival = fitter.fit_mirrored(view.pixels, pose)
    assert rival.source == source
    assert angle_deg(rival.rotation, view.rotation) > 15.0


@pytest.mark.parametrize(("distance", "tilt_deg"), [(2.0, 3.0), (3.0, 10.0), (4.5, 25.0), (4.5, 7.0), (6.5, 50.0)])
def test_an_image_agrees_where_perspective_rules_the_mirror_image_out(distance, tilt_deg):
    """The fit from the mirror image comes back, or has as much against it as a decision asks for."""
    target = shipped("single")
    view, fitter = View(target, place(distance, np.radians(tilt_deg))), TargetFitter(target, Projection(VGA))
    pose = fitter.refine(view.pixels, nearly(view))
    assert pose is not None
    assert fitter.mirror_odds(view.pixels, pose) > DECIDED
    rival = fitter.fit_mirrored(view.pixels, pose)
    if rival is not None and angle_deg(rival.rotation, pose.rotation) > 1.0:
        assert log_odds(pose, rival) > DECIDED


def test_a_target_that_leaves_the_image_shows_too_little_of_its_perspective():
    target = shipped("single")
    view, fitter = View(target, place(2.6, np.radians(30.0))), TargetFitter(target, Projection(VGA))
    pose = fitter.refine(view.pixels, nearly(view))
    assert pose is not None
    assert fitter.mirror_odds(view.pixels, pose) > DECIDED
    middle = round(VGA.fx * float(view.position[0] / view.position[2]) + VGA.cx)
    assert fitter.mirror_odds(view.pixels[:, :middle], pose) == 0.0
