"""Which measurement a pose comes from: edges, grey values or neither, of sharp and smeared images and mirror images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose import photofit
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import GREY_EFFORT, TargetFitter
from mkdaemon.vision.pose.gates import fit_refusal
from mkdaemon.vision.pose.pose import Pose, turn, with_floor
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import Cover, LightConditions
from tests.vision.views import VGA, View, angle_deg, assert_near, nearly, nees, place, shipped, start_at

PROJECTION = Projection(VGA)
TARGET = shipped("single")
CELL = TARGET.tags[0].module
DISTANCE = VGA.fx * CELL / 4.5
"""Cells of 4.5 px [m]."""


def beside(view: View, degrees: float = 0.6, part: float = 0.004) -> Pose:
    """A start near the truth."""
    rotation = turn(view.rotation, np.radians(np.array([degrees, -degrees, degrees])))
    return Pose(rotation, view.position * (1.0 + part), np.eye(6), "corners", 4, 0.1)


DUSK = LightConditions(exposure=0.06, noise_sd=3.0, shot_gain=0.1)


@pytest.mark.parametrize(
    ("cell_px", "conditions", "share"),
    [(4.5, LightConditions(psf_px=1.0), 0.75), (8.0, DUSK, 0.6)],
    ids=["cells of four to five pixels", "dusk"],
)
def test_grey_values_measure_what_edges_have_found(cell_px: float, conditions: LightConditions, share: float) -> None:
    """By all pixels, where cells are small and where edges are noisy."""
    fitter, edges, errors = TargetFitter(TARGET, PROJECTION), EdgeFit(TARGET, PROJECTION), []
    for tilt, around in ((0.15, 0.3), (0.25, 3.0), (0.45, 4.4)):
        view = View(TARGET, place(VGA.fx * CELL / cell_px, tilt, around), conditions)
        found, alone = fitter.refine(view.pixels, beside(view)), edges.fit(view.pixels, beside(view))
        assert (found.source, alone.source) == ("photometric", "edges")
        if conditions is DUSK:
            assert found.rms_px > LIMITS.certainty.blind_rms_px > found.unexplained_px
            assert fit_refusal(found, TrackerSection()) is None
        # the camera's place in the target's frame
        true = view.rotation.T @ view.position
        errors.append([np.linalg.norm(pose.rotation.T @ pose.position - true) for pose in (found, alone)])
    by_grey, by_edges = np.mean(errors, axis=0)
    assert by_grey < share * by_edges


@pytest.mark.parametrize(("distance", "spent"), [(0.5, 1), (DISTANCE, GREY_EFFORT)])
def test_a_print_that_is_too_large_for_grey_values_spends_nothing_on_them(distance: float, spent: int) -> None:
    """Told at once; counted as a fit, no other start was tried, and a near tag under a cover was lost for good."""
    view = View(TARGET, place(distance, 0.2))
    fitter = TargetFitter(TARGET, PROJECTION)
    fitted = fitter.fit_grey_values(view.pixels, [beside(view)])
    assert bool(fitted) is (spent == GREY_EFFORT)
    assert fitter.effort == spent


def smeared(
    streak_px: float,
    way: float,
    conditions: LightConditions | None = None,
    name: str = "single",
    distance: float = 4.2,
    **view: float,
) -> View:
    """A view during which the camera turned by so many pixels, one way in the image [rad]; cells of 5.4 px."""
    exposure = 0.015
    rate = streak_px / VGA.fx / exposure * np.array([-np.sin(way), np.cos(way), 0.0])
    seen = place(distance, **({"tilt": 0.2} | view))
    return View(shipped(name), replace(seen, rate_cam=rate, exposure_time=exposure), conditions)


def predicted(view: View) -> Pose:
    """A prediction that is off by three pixels, half a percent of the range and half a degree."""
    turned = turn(view.rotation, np.radians([0.5, -0.4, 0.3]))
    off = np.array([-2.5, 2.0, 0.0]) / VGA.fx * view.position[2]
    return Pose(turned, 1.005 * view.position + off, 1e-6 * np.eye(6), "edges", 200, 0.05)


@pytest.mark.parametrize(
    ("streak_px", "way", "source"), [*((6.0, way, "photometric") for way in (0.2, 1.7)), (0.5, 0.9, "edges")]
)
def test_a_smeared_target_is_measured_by_its_grey_values(streak_px: float, way: float, source: str) -> None:
    view = smeared(streak_px, way)
    found = TargetFitter(TARGET, PROJECTION).refine(view.pixels, nearly(view))
    assert_near(found, view, deg=0.6, source=source)
    assert nees(view, found, with_floor(found)) < 3.0


@pytest.mark.parametrize("is_covered", [True, False])
def test_grey_values_that_the_print_does_not_explain_or_that_have_not_arrived_are_left_out(
    monkeypatch: pytest.MonkeyPatch, is_covered: bool
) -> None:
    if is_covered:
        over_one_side = Cover(((-0.3, 0.1), (0.3, 0.1), (0.3, 0.3), (-0.3, 0.3)), 0.5)
        view = smeared(6.0, 0.9, LightConditions(covers=(over_one_side,)))
    else:
        monkeypatch.setattr(photofit, "STEPS", 1)
        view = smeared(8.0, 0.2)
    found = TargetFitter(TARGET, PROJECTION).refine(view.pixels, nearly(view))
    assert found is None or found.source == "edges"


def test_the_grey_values_find_a_streak_longer_than_the_cells() -> None:
    """Cells of 8 px; a streak along one way of the edges leaves those sharp, and they may have found it."""
    views = [smeared(12.0, way, distance=2.8) for way in (0.4, 0.8, 1.2, 2.3)]
    fitter = TargetFitter(TARGET, PROJECTION)
    found = [(view, pose) for view in views if (pose := fitter.refine(view.pixels, predicted(view))) is not None]
    assert sum(pose.source == "photometric" for _, pose in found) >= len(views) - 1
    assert np.median([angle_deg(pose.rotation, view.rotation) for view, pose in found]) < 0.7
    assert max(nees(view, pose) for view, pose in found) < 7.0


DIM = replace(LightConditions(), exposure=0.06, noise_sd=2.5)
BLURRED = replace(LightConditions(), defocus_px=5.0)


@pytest.mark.parametrize(
    ("distance", "conditions"), [(4.0, None), (4.0, DIM), (1.0, BLURRED)], ids=["bright", "dim", "blurred"]
)
def test_the_whole_image_of_a_target_is_found_again(distance, conditions):
    """The same place, the camera turned by one and a half degrees."""
    target = shipped("nested")
    before = View(target, place(distance, 0.2))
    turned = turn(before.view.enu_from_cam, np.radians([1.0, -1.1, 0.4]))
    after = View(target, replace(before.view, enu_from_cam=turned), conditions)
    carried = TargetFitter(target, PROJECTION).carried(before.pixels, after.pixels, start_at(before, sd=1.0))
    corners = target.tags[0].corners
    seen, truth = (PROJECTION.project(corners @ at.rotation.T + at.position)[0] for at in (carried, after))
    assert np.abs(seen - truth).max() < 0.1 * VGA.fx * target.tags[0].size / distance


def test_what_is_not_there_is_not_found():
    target = shipped("nested")
    before = View(target, place(3.0, 0.2))
    empty = View(target, place(3.0, 0.2), replace(LightConditions(), target_in_view=False))
    pose, fitter = start_at(before, sd=1.0), TargetFitter(target, PROJECTION)
    for start in (pose, replace(pose, position=np.array([9.0, 0.0, 1.0]))):
        assert fitter.carried(before.pixels, empty.pixels, start) is None
