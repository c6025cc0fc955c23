"""Which measurement a pose comes from: edges, grey values after edges, and when neither is believed."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import GREY_EFFORT, TargetFitter
from mkdaemon.vision.pose.gates import fit_refusal
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import Cover, LightConditions
from tests.vision.views import VGA, View, place, shipped

PROJECTION, TARGET = Projection(VGA), shipped("single")
CELL = TARGET.tags[0].module
DISTANCE = VGA.fx * CELL / 4.5
"""Cells of 4.5 px [m]."""


def beside(view: View, degrees: float = 0.6, part: float = 0.004) -> Pose:
    """A start near the truth."""
    rotation = turn(view.rotation, np.radians(np.array([degrees, -degrees, degrees])))
    return Pose(rotation, view.position * (1.0 + part), np.eye(6), "corners", 4, 0.1)


def off(pose: Pose, view: View) -> float:
    """How far the camera's place in the target's frame is off [m]."""
    error: npt.NDArray[np.float64] = pose.rotation.T @ pose.position - view.rotation.T @ view.position
    return float(np.linalg.norm(error))


def test_cells_of_four_to_five_pixels_are_measured_by_grey_values() -> None:
    fitter, edges = TargetFitter(TARGET, PROJECTION), EdgeFit(TARGET, PROJECTION)
    mixed_errors, edge_errors = [], []
    for tilt, around in ((0.15, 0.3), (0.35, 1.4), (0.25, 3.0), (0.45, 4.4), (0.3, 5.6)):
        view = View(TARGET, place(DISTANCE, tilt, around), LightConditions(psf_px=1.0))
        found, alone = fitter.refine(view.pixels, beside(view)), edges.fit(view.pixels, beside(view))
        assert (found.source, alone.source) == ("photometric", "edges")
        mixed_errors.append(off(found, view))
        edge_errors.append(off(alone, view))
    assert np.mean(mixed_errors) < 0.75 * np.mean(edge_errors)


def test_in_dusk_all_pixels_measure_what_noisy_edges_have_found() -> None:
    dusk = LightConditions(exposure=0.06, noise_sd=3.0, shot_gain=0.1)
    fitter, edges = TargetFitter(TARGET, PROJECTION), EdgeFit(TARGET, PROJECTION)
    errors, edge_errors = [], []
    for tilt, around in ((0.15, 0.3), (0.35, 1.4), (0.25, 3.0), (0.45, 4.4), (0.3, 5.6)):
        view = View(TARGET, place(VGA.fx * CELL / 8.0, tilt, around), dusk)
        found, alone = fitter.refine(view.pixels, beside(view)), edges.fit(view.pixels, beside(view))
        assert alone is not None
        assert found.source == "photometric"
        assert found.rms_px > LIMITS.certainty.blind_rms_px > found.unexplained_px
        assert fit_refusal(found, TrackerSection()) is None
        errors.append(off(found, view))
        edge_errors.append(off(alone, view))
    assert np.mean(errors) < 0.6 * np.mean(edge_errors)


def test_what_lies_over_a_small_print_is_in_the_covariance() -> None:
    half = TARGET.tags[0].size / 2
    corner = ((-half, -half), (-0.35 * half, -half), (-0.35 * half, 0.1 * half), (-half, 0.1 * half))
    view = View(TARGET, place(DISTANCE, 0.3, 1.0), LightConditions(covers=(Cover(corner, 0.5),)))
    found = TargetFitter(TARGET, PROJECTION).refine(view.pixels, beside(view))
    turned = np.asarray(cv2.Rodrigues(view.rotation @ found.rotation.T)[0], dtype=np.float64).ravel()
    error = np.concatenate([view.position - found.position, turned])
    assert float(error @ np.linalg.solve(found.covariance, error)) / 6 < 2.0


@pytest.mark.parametrize("cells", [4.0, 6.0])
def test_grey_values_do_not_begin_where_nothing_resembles_the_print(cells: float) -> None:
    view = View(TARGET, place(VGA.fx * CELL / 3.8, 0.2, 0.8))
    start = beside(view, 0.0, 0.0)
    moved = replace(start, position=start.position + np.array([cells * CELL, 0.5 * cells * CELL, 0.0]))
    assert PhotoFit(TARGET, PROJECTION).fit(view.pixels, moved) is None
    near = PhotoFit(TARGET, PROJECTION).fit(view.pixels, beside(view))
    assert float(np.linalg.norm(near.position - view.position)) < 0.01


@pytest.mark.parametrize(("distance", "spent"), [(0.5, 1), (DISTANCE, GREY_EFFORT)])
def test_a_print_that_is_too_large_for_grey_values_spends_nothing_on_them(distance: float, spent: int) -> None:
    """Told at once; counted as a fit, no other start was tried, and a near tag under a cover was lost for good."""
    view = View(TARGET, place(distance, 0.2))
    fitter = TargetFitter(TARGET, PROJECTION)
    fitted = fitter.fit_grey_values(view.pixels, [beside(view)])
    assert bool(fitted) is (spent == GREY_EFFORT)
    assert fitter.effort == spent
