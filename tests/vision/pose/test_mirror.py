"""The mirror image of a pose is measured as the pose was: losses compare only between fits of one kind."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from tests.vision.views import VGA, View, angle_deg, place, shipped


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
    assert rival is not None
    assert rival.source == source
    assert angle_deg(rival.rotation, view.rotation) > 15.0
