"""Fits to the grey values of a far print under a rolling shutter arrive, or say how far they are from their place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from lab.vision.stills import error_of, target_named
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose import photofit
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import Pose, length2, turn
from mkdaemon.vision.pose.prints import Prints
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import Prior
from mksim.scene.light import LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import CameraView, view_towards

LENS = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5, line_time=30e-3 / 480)
PAD = SceneTarget.of(target_named("nested"), Platform())


def turning_view(seed: int) -> tuple[npt.NDArray[np.uint8], Pose, Pose]:
    """A print 6 to 7 m away, in the outer half of the image of a camera that turns: pixels, truth and a start."""
    rng = np.random.default_rng(seed)
    eye = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(6.0, 7.2)])
    away, around = rng.uniform(1.0, 2.0), rng.uniform(0.0, 6.28)
    at_rest = view_towards(LENS, eye, away * np.array([np.cos(around), np.sin(around), 0.0]))
    rate = 0.5 * rng.standard_normal(3)
    view = CameraView(LENS, at_rest.enu_from_cam, eye, rate_cam=rate, line_time=LENS.line_time)
    rotation, position = cam_from_target(PAD, view)
    pixels = Scene([PAD], ground=None, seed=seed, fine=False).render(view, LightConditions())
    axis = rng.standard_normal(3) * (1.0, 1.0, 0.2)
    turned = turn(rotation, axis * np.radians(5.0) / np.linalg.norm(axis))
    start = Pose(turned, position * 1.005 + np.array([0.03, -0.02, 0.0]), np.eye(6), "corners", 4, 0.1)
    return pixels, replace(start, rotation=rotation, position=position, motion=np.array([*rate, 0.0])), start


FAR = 20
"""Steps from a start that is turned by five degrees."""


def test_costs_fall_along_the_way_to_the_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light and what the motion lacks are told at once: one after the other, costs rose, and fits ended beside it.

    Starts are turned by five degrees: from some of them no fit arrives.
    """
    arrived = 0
    for seed in range(1, 9):
        pixels, truth, start = turning_view(seed)
        fitter = PhotoFit(PAD.target, Projection(LENS))
        best = fitter.fit(pixels, truth)
        with monkeypatch.context() as patched:
            patched.setattr(photofit, "STEPS", FAR)
            found = fitter.fit(pixels, start)
        assert best.cost is not None
        if found is None or found.cost is None:
            continue
        apart = error_of(found.rotation, found.position, truth.rotation, truth.position)
        error = np.array([*apart.xyz, *apart.rpy])
        nees = float(error @ np.linalg.solve(found.covariance, error)) / 6.0
        # A sixteenth of the pixels' log odds, as neighbours share what they show.
        arrived += found.points / 16.0 * np.log(found.cost / best.cost) < 2.0 and nees < 3.0
    assert arrived >= 4


def test_how_far_a_fit_is_from_its_place_is_told_without_damping() -> None:
    """A short damped step is no sign of having arrived: the fit would claim to be where it stays."""
    pixels, _, start = turning_view(1)
    projection = Projection(LENS)
    prints = Prints(PAD.target, projection)
    prior = Prior(start, None, projection, prints.sheet)
    at = prior.begin(0.7)
    models = prints.seen(at.rotation, at.position)
    step = PhotoFit(PAD.target, projection).step(pixels, models, at, prior)
    taken = step.change(1.0)[:6]
    assert length2(taken, step.pose(at, prior).covariance) < 0.5 * step.length2
    np.testing.assert_allclose(step.to_go, step.change(1e-7)[:6], rtol=1e-2, atol=1e-5)
