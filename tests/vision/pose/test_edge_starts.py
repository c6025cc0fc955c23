"""A fit of edges finds its place from a start that is off along one side of the print, or by more than small cells."""

from __future__ import annotations

import numpy as np
import pytest

from lab.vision.flight import VGA
from lab.vision.stills import error_of, target_named
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.pose import Pose, largest_variance, turn
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import CLEAN
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import view_towards


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("distance", [0.9, 1.5])
@pytest.mark.parametrize("name", ["single", "nested", "nested-36"])
def test_a_start_that_is_off_along_one_side_ends_at_the_place(name: str, distance: float, axis: int) -> None:
    pad = SceneTarget.of(target_named(name), Platform())
    view = view_towards(VGA, distance * np.array([0.2, 0.1, 0.97]), np.zeros(3))
    rotation, position = cam_from_target(pad, view)
    pixels = Scene([pad], ground=None, seed=4, fine=False).render(view, CLEAN)
    fitter = EdgeFit(pad.target, Projection(VGA))
    for off_px in np.arange(-6.0, 6.1, 1.0):
        off = rotation[:, axis] * off_px * distance / VGA.fx
        found = fitter.fit(pixels, Pose(rotation, position + off, np.eye(6), "corners", 4, 0.1))
        assert found is not None, off_px
        error = error_of(found.rotation, found.position, rotation, position)
        assert error.distance < 0.0002, off_px  # by one median for all edges most of them end 1-27 cm off, or nowhere
        assert found.inliers > 0.95, off_px


@pytest.mark.parametrize("off_px", [6.0, 8.0])
def test_cells_that_do_not_reach_their_edges_hold_no_first_step_back(off_px: float) -> None:
    """Half a cell of the inner tag is 4 px: with as much say as the others its edges kept the target 3 px off."""
    pad = SceneTarget.of(target_named("nested"), Platform())
    view = view_towards(VGA, 0.7 * np.array([0.2, 0.1, 0.97]), np.zeros(3))
    rotation, position = cam_from_target(pad, view)
    pixels = Scene([pad], ground=None, seed=4, fine=False).render(view, CLEAN)
    off = np.array([off_px, -off_px, 0.0]) * 0.7 / VGA.fx
    start = Pose(rotation, position + off, np.eye(6), "corners", 4, 0.1)
    found = EdgeFit(pad.target, Projection(VGA)).fit(pixels, start, iterations=1)
    left_px = VGA.fx * float(np.linalg.norm((found.position - position)[:2])) / 0.7
    assert left_px < 0.3


def test_a_fit_that_has_not_arrived_says_how_far_it_would_go_on() -> None:
    pad = SceneTarget.of(target_named("nested"), Platform())
    view = view_towards(VGA, np.array([0.4, 0.2, 1.5]), np.zeros(3))
    rotation, position = cam_from_target(pad, view)
    pixels = Scene([pad], ground=None, seed=4, fine=False).render(view, CLEAN)
    start = Pose(turn(rotation, np.array([0.08, -0.05, 0.0])), 0.99 * position, np.eye(6), "corners", 4, 0.1)
    fitter = EdgeFit(pad.target, Projection(VGA))
    broken_off, arrived = (fitter.fit(pixels, start, iterations=count) for count in (1, 12))
    off = error_of(broken_off.rotation, broken_off.position, rotation, position)
    assert largest_variance(arrived.covariance[3:, 3:]) < np.radians(0.1) ** 2
    assert off.angle_deg > 0.5
    assert largest_variance(broken_off.covariance[3:, 3:]) > np.radians(off.angle_deg) ** 2
