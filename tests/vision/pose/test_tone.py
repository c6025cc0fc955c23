"""A tone curve and sharpening move every edge: poses stay where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from lab.vision.flight import VGA
from lab.vision.stills import error_of, target_named
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mksim.scene.light import LightConditions
from mksim.scene.motion import Platform
from mksim.scene.processing import NO_PROCESSING, Processing
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import CameraView, view_towards

PAD = SceneTarget.of(target_named("single"), Platform())
GAMMA = Processing(gamma=2.2)
WEBCAM = Processing(gamma=2.2, sharpening=0.8)


def processed(processing: Processing) -> LightConditions:
    return LightConditions(vignetting=0.0, noise_sd=0.5, shot_gain=0.0, processing=processing)


def rendered(view: CameraView, conditions: LightConditions) -> npt.NDArray[np.uint8]:
    """An image by a scene of its own: the noise of a shared one would depend on which tests ran before."""
    return Scene([PAD], ground=None, seed=4, fine=False).render(view, conditions)


def fit(fitter: EdgeFit | PhotoFit, distance: float, processing: Processing) -> tuple[Pose, float]:
    """A fitted pose, and its distance over the true one, less 1."""
    view = view_towards(VGA, distance * np.array([0.3, 0.2, 0.93]), np.zeros(3))
    rotation, position = cam_from_target(PAD, view)
    start = Pose(rotation, position * 1.003, np.eye(6), "corners", 4, 0.1)
    found = fitter.fit(rendered(view, processed(processing)), start)
    return found, found.range_m / float(np.linalg.norm(position)) - 1.0


@pytest.mark.parametrize("processing", [NO_PROCESSING, GAMMA, WEBCAM], ids=["linear", "gamma", "webcam"])
@pytest.mark.parametrize("distance", [1.0, 3.0])
def test_the_range_by_edges_is_right_under_any_tone_curve(distance: float, processing: Processing) -> None:
    found, farther = fit(EdgeFit(PAD.target, Projection(VGA)), distance, processing)
    assert abs(farther) < 0.001  # without the common shift 0.3 and 0.6 % under gamma
    assert (found.shift_px < -0.15) == (processing is not NO_PROCESSING)


@pytest.mark.parametrize("processing", [NO_PROCESSING, GAMMA], ids=["linear", "gamma"])
def test_the_range_by_grey_values_is_right_under_a_tone_curve(processing: Processing) -> None:
    _, farther = fit(PhotoFit(PAD.target, Projection(VGA)), 8.0, processing)
    assert abs(farther) < 0.002  # without the term of the tone curve 0.5 % under gamma


def test_grey_values_follow_a_tone_curve_to_the_noise() -> None:
    fitter = PhotoFit(replace(PAD.target, bend=0.0), Projection(VGA))
    linear, curved = (fit(fitter, 5.0, processing)[0].rms_px for processing in (NO_PROCESSING, GAMMA))
    assert curved < 1.1 * linear  # 1.27 with a cubic polynomial alone


def test_located_edges_lie_at_the_pose_when_their_common_shift_is_known() -> None:
    fitter = EdgeFit(PAD.target, Projection(VGA))
    view = view_towards(VGA, np.array([0.3, 0.2, 2.0]), np.zeros(3))
    rotation, position = cam_from_target(PAD, view)
    pixels = rendered(view, processed(GAMMA))
    found = fitter.fit(pixels, Pose(rotation, position, np.eye(6), "corners", 4, 0.1))
    assert found is not None
    located = fitter.locate(pixels, found)
    assert located is not None
    _, edges, _ = located
    assert abs(float(np.median(edges.offsets[edges.found]))) < 0.03


@pytest.mark.parametrize("angle", [0.0, 0.8, 2.2])
def test_a_far_print_smeared_by_motion_is_fitted_with_its_smear(angle: float) -> None:
    rate = 1.2 * np.array([np.sin(angle), np.cos(angle), 0.0])
    view = view_towards(VGA, np.array([1.2, -0.8, 6.5]), np.array([0.1, 0.0, 0.0]))
    view = replace(view, rate_cam=rate, exposure_time=0.004)
    rotation, position = cam_from_target(PAD, view)
    start = Pose(rotation, position * 1.003, np.eye(6), "corners", 4, 0.1)
    found = PhotoFit(PAD.target, Projection(VGA)).fit(rendered(view, LightConditions()), start)
    error = error_of(found.rotation, found.position, rotation, position)
    assert error.distance < 0.012
    assert error.angle_deg < 1.2
