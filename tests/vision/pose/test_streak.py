"""A streak of motion that is longer than edges are searched for, or than the cells of the target."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, angle_between, turn
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import Cover, LightConditions
from mksim.scene.processing import Processing
from tests.vision.views import VGA, View, place, shipped

PROJECTION = Projection(VGA)
WAYS = (0.1, 0.8, 1.6, 2.3)


def smeared(
    name: str, distance: float, streak_px: float, way: float, conditions: LightConditions | None = None
) -> View:
    """A view during which the camera turned by so many pixels, one way in the image [rad]."""
    exposure = 0.015
    rate = streak_px / VGA.fx / exposure * np.array([-np.sin(way), np.cos(way), 0.0])
    return View(shipped(name), replace(place(distance, 0.2), rate_cam=rate, exposure_time=exposure), conditions)


def start(view: View) -> Pose:
    """A prediction that is off by three pixels, half a percent of the range and half a degree."""
    turned = turn(view.rotation, np.radians([0.5, -0.4, 0.3]))
    beside = np.array([-2.5, 2.0, 0.0]) / VGA.fx * view.position[2]
    return Pose(turned, 1.005 * view.position + beside, 1e-6 * np.eye(6), "edges", 200, 0.05)


def nees(view: View, pose: Pose) -> float:
    """Of the measurement alone, per degree of freedom."""
    turned = cv2.Rodrigues(view.rotation @ pose.rotation.T)[0].ravel()
    error = np.concatenate([view.position - pose.position, turned])
    return float(error @ np.linalg.solve(pose.covariance, error)) / 6


@pytest.mark.parametrize("way", WAYS)
def test_a_tone_curve_shifts_edges_that_motion_widens_more_than_others(way: float) -> None:
    """By one shift for all, a print that looks shorter one way was tilted by a degree."""
    view = smeared("single", 2.2, 3.0, way, LightConditions(processing=Processing(gamma=2.2)))
    found = EdgeFit(shipped("single"), PROJECTION).fit(view.pixels, start(view))
    assert np.degrees(angle_between(found.rotation, view.rotation)) < 0.35


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("streak_px", [8.0, 16.0])
def test_wide_edges_of_a_near_target_are_found_in_their_middle(streak_px: float, way: float) -> None:
    """Cells of 27 px; those of the inner tag have 4 px and melt."""
    view = smeared("nested", 0.85, streak_px, way)
    found = EdgeFit(shipped("nested"), PROJECTION).fit(view.pixels, start(view))
    assert np.degrees(angle_between(found.rotation, view.rotation)) < 0.15
    assert np.linalg.norm(found.position - view.position) < 0.001
    assert nees(view, found) < 4.0
    assert found.inliers > LIMITS.agreement.blind  # edges that melt speak for nothing


@pytest.mark.parametrize("streak_px", [12.0, 20.0])
def test_the_grey_values_find_a_streak_longer_than_the_cells(streak_px: float) -> None:
    """Cells of 8 px; a streak along one way of the edges leaves those sharp, and they may have found it."""
    ways = (0.1, 0.4, 0.8, 1.2, 1.6, 2.0, 2.3, 2.8)
    views = [smeared("single", 2.8, streak_px, way) for way in ways]
    fitter = TargetFitter(shipped("single"), PROJECTION)
    found = [(view, pose) for view in views if (pose := fitter.refine(view.pixels, start(view))) is not None]
    turned = [np.degrees(angle_between(pose.rotation, view.rotation)) for view, pose in found]
    assert sum(pose.source == "photometric" for _, pose in found) >= len(ways) - 2
    assert np.sort(turned)[: len(ways) - 1].max() < 0.9
    assert np.median(turned) < 0.7
    assert max(nees(view, pose) for view, pose in found) < 7.0


def test_edges_that_the_grey_values_contradict_are_as_uncertain_as_both_are_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    view = smeared("single", 2.8, 20.0, 0.8)
    fitter = TargetFitter(shipped("single"), PROJECTION)
    edges = EdgeFit(shipped("single"), PROJECTION).fit(view.pixels, start(view))
    assert edges is not None
    monkeypatch.setattr(fitter._photo, "explains", lambda _grey: False)
    found = fitter.refine(view.pixels, start(view))
    assert found.source == "edges"
    assert nees(view, edges) > 4.0
    assert nees(view, found) < 1.0


@pytest.mark.parametrize("distance", [1.2, 2.8])
def test_a_sharp_target_below_a_cover_stays_certain(distance: float) -> None:
    cover = Cover(((-0.3, 0.11), (0.3, 0.11), (0.3, 0.3), (-0.3, 0.3)), 0.4)
    view = smeared("single", distance, 0.5, 0.8, LightConditions(covers=(cover,)))
    found = TargetFitter(shipped("single"), PROJECTION).refine(view.pixels, start(view))
    assert found.source == "edges"
    assert found.inliers > LIMITS.agreement.blind
    assert np.degrees(np.sqrt(np.linalg.eigvalsh(found.covariance[3:, 3:])[-1])) < 0.3
    assert nees(view, found) < 4.0
