"""Edges that melt into each other, as motion blurs them, are left for the grey values; other edges are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.pose import photofit
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import angle_between, with_floor
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import Cover, LightConditions
from tests.vision.views import VGA, View, nearly, nees, place, shipped

TARGET = shipped("single")
DISTANCE = 4.2
"""Cells of 5.4 px."""
OVER_ONE_SIDE = Cover(((-0.3, 0.1), (0.3, 0.1), (0.3, 0.3), (-0.3, 0.3)), 0.5)


def smeared(
    streak_px: float,
    way: float,
    conditions: LightConditions | None = None,
    distance: float = DISTANCE,
    tilt: float = 0.2,
    around: float = 0.3,
) -> View:
    """A view during which the camera turned by so many pixels, one way in the image [rad]."""
    exposure = 0.015
    rate = streak_px / VGA.fx / exposure * np.array([-np.sin(way), np.cos(way), 0.0])
    view = replace(place(distance, tilt, around), rate_cam=rate, exposure_time=exposure)
    return View(TARGET, view, conditions)


@pytest.mark.parametrize("way", [0.2, 0.9, 1.7, 2.4])
def test_a_smeared_target_is_measured_by_its_grey_values(way: float) -> None:
    view = smeared(6.0, way)
    found = TargetFitter(TARGET, Projection(VGA)).refine(view.pixels, nearly(view))
    assert found.source == "photometric"
    assert np.degrees(angle_between(found.rotation, view.rotation)) < 0.6
    assert nees(view, found, with_floor(found)) < 3.0


def test_a_sharp_target_is_measured_by_its_edges() -> None:
    view = smeared(0.5, 0.9)
    found = TargetFitter(TARGET, Projection(VGA)).refine(view.pixels, nearly(view))
    assert found.source == "edges"


def test_grey_values_that_the_print_does_not_explain_are_left_out() -> None:
    view = smeared(6.0, 0.9, LightConditions(covers=(OVER_ONE_SIDE,)))
    found = TargetFitter(TARGET, Projection(VGA)).refine(view.pixels, nearly(view))
    assert found is None or found.source == "edges"


def test_grey_values_that_have_not_arrived_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photofit, "STEPS", 1)
    view = smeared(8.0, 0.2)
    found = TargetFitter(TARGET, Projection(VGA)).refine(view.pixels, nearly(view))
    assert found is None or found.source == "edges"


def test_the_mirror_image_of_a_smeared_target_is_measured_the_same_way() -> None:
    view = smeared(6.0, 0.9)
    fitter = TargetFitter(TARGET, Projection(VGA))
    found = fitter.refine(view.pixels, nearly(view))
    assert found is not None
    rival = fitter.fit_mirrored(view.pixels, found)
    assert rival is None or rival.source == "photometric"


def test_the_mirror_image_is_fitted_at_the_resolution_of_the_pose() -> None:
    """The noise of half an image is another one: their losses did not compare, whichever was right."""
    view = smeared(12.0, 0.1, distance=2.8, tilt=0.3)
    fitter = TargetFitter(TARGET, Projection(VGA))
    found = fitter.refine(view.pixels, nearly(view))
    assert found.is_halved
    rival = fitter.fit_mirrored(view.pixels, found)
    assert rival.is_halved


def test_edges_that_a_streak_melts_are_believed_less_than_those_along_it() -> None:
    """Two poses beside a glare, on edges 0.7 of a cell wide one way, were off by 5 cm and claimed far less."""
    honest = []
    for around in np.arange(24) * np.pi / 12:
        view = smeared(6.0, round(around) % 2 * np.pi / 2, distance=4.4, tilt=0.25, around=around)
        found = EdgeFit(TARGET, Projection(VGA)).fit(view.pixels, nearly(view))
        honest.append(nees(view, found, found.covariance))
    assert np.median(honest) < 1.9
