"""Light that is blown, floods cells, grows over a print or is bent by a tone curve moves edges: poses stay."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from lab.vision.stills import error_of, target_named
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.edgefind import FoundEdges, find_edges
from mkdaemon.vision.pose.edgefit import EdgeFit, shifts
from mkdaemon.vision.pose.edgemodel import Samples
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import CellReader
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import Unknowns
from mksim.scene.gloss import Gloss
from mksim.scene.light import LightConditions
from mksim.scene.motion import Platform
from mksim.scene.processing import NO_PROCESSING, Processing
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import CameraView, view_towards
from tests.vision.views import VGA, View, angle_deg, nearly, nees, place, shipped

TARGET = replace(shipped("nested"), bend=0.0)
COUNT = 60
CONTRAST = 150.0
EDGE_AT = 32.3
FINE = 8
"""Sub-samples a pixel."""


def edge(seen: float, growing: float = 0.0) -> FoundEdges:
    """An upright edge in an image whose paper is blown below row 32, where `seen` of the contrast is left.

    Args:
        seen: share of the contrast.
        growing: of the light along x [grey/px].
    """
    place = np.arange(64 * FINE) / FINE - 0.5 + 0.5 / FINE
    sharp = (place > EDGE_AT).astype(np.float32)[None]
    blurred = cv2.GaussianBlur(sharp, (0, 0), 0.6 * FINE)[0].reshape(64, FINE).mean(axis=1)
    rise = CONTRAST * blurred + growing * (np.arange(64) - EDGE_AT)
    rows = np.vstack([np.tile(50.0 + rise, (32, 1)), np.tile(255.0 - seen * CONTRAST + rise, (32, 1))])
    samples = Samples(
        np.arange(COUNT),
        np.column_stack([np.full(COUNT, 32.0), np.linspace(2.0, 61.0, COUNT)]),
        np.tile([1.0, 0.0], (COUNT, 1)),
        np.full(COUNT, 2.5),
        np.full(COUNT, 30.0),
        np.ones(COUNT, dtype=bool),
    )
    return find_edges(np.clip(np.rint(rows), 0, 255).astype(np.uint8), samples)


@pytest.mark.parametrize("seen", [0.9, 0.7, 0.5, 0.35])
@pytest.mark.parametrize("growing", [-1.5, 0.0, 1.5])
def test_a_blown_edge_is_found_where_a_whole_one_is(seen: float, growing: float) -> None:
    found = edge(seen, growing)
    assert found.found.all()
    assert abs(found.offsets[-1] - found.offsets[0]) < 0.15
    assert found.blown == 0.5
    assert found.trust[-1] < found.trust[0]


def test_nothing_is_moved_where_no_paper_is_blown() -> None:
    found = edge(1.3)
    assert found.blown == 0.0
    assert found.light is None


@pytest.mark.parametrize(("beside", "distance"), [(0.12, 1.6), (0.12, 2.3), (0.15, 2.3), (0.15, 2.8)])
def test_a_highlight_does_not_turn_the_pose(beside: float, distance: float) -> None:
    """It lies over one side of a print seen from nearly above; without what clipping does 2.8 to 7.6 degrees."""
    gloss = Gloss(0.06, (np.sin(beside), 0.0, np.cos(beside)))
    view = View(TARGET, place(distance, 0.03, around=7.0 * beside), LightConditions(gloss=gloss))
    pose = EdgeFit(TARGET, Projection(VGA)).fit(view.pixels, nearly(view))
    assert angle_deg(view.rotation, pose.rotation) < 1.5
    assert nees(view, pose, pose.covariance) < 5.5
    assert pose.inliers > LIMITS.agreement.blind


OVER = LightConditions(exposure=1.8)


def test_motion_moves_blown_edges_across_it_only() -> None:
    """Edges of one way are wider and clipped farther from their middle: one blur for both turned poses by 1.1 deg."""
    off, surprise = [], []
    for around in (0.0, 1.3, 2.6):
        rate = 2.4 / VGA.fx / 0.004 * np.array([np.sin(around), np.cos(around), 0.0])
        view = View(TARGET, replace(place(2.9, 0.15, around), rate_cam=rate, exposure_time=0.004), OVER)
        pose = EdgeFit(TARGET, Projection(VGA)).fit(view.pixels, nearly(view))
        off.append(angle_deg(view.rotation, pose.rotation))
        surprise.append(nees(view, pose, pose.covariance))
    assert np.mean(off) < 0.5
    assert np.mean(surprise) < 1.5


def test_blown_paper_tells_grey_values_nothing() -> None:
    """Fitted as if it ended at the largest grey value it put a print 3 to 4 mm too near or too far at 5 m."""
    views = [View(TARGET, place(5.0, tilt, 7.0 * tilt), OVER) for tilt in (0.05, 0.15, 0.25, 0.35)]
    found = [(view, PhotoFit(TARGET, Projection(VGA)).fit(view.pixels, nearly(view))) for view in views]
    assert np.mean([nees(view, pose, pose.covariance) for view, pose in found if pose is not None]) < 3.0
    assert all(pose is not None and pose.likeness is not None and pose.likeness > 0.95 for _, pose in found)


@pytest.mark.parametrize(("exposure", "source"), [(1.8, "photometric"), (1.0, "edges")])
def test_small_cells_of_blown_paper_are_measured_by_grey_values(exposure: float, source: str) -> None:
    """Their corners are dimmer and clipped less: edges of 5 px cells put the print 4 mm too far, 1.6 claimed."""
    view = View(TARGET, place(4.4, 0.2), LightConditions(exposure=exposure))
    pose = TargetFitter(TARGET, Projection(VGA)).refine(view.pixels, nearly(view))
    assert pose.source == source
    assert nees(view, pose, pose.covariance) < 3.0


@pytest.mark.parametrize("tilt", [0.0, 0.03, 0.06])
def test_cells_that_a_highlight_floods_contradict_no_pose_and_the_others_do(tilt: float) -> None:
    target = shipped("nested")
    view = View(target, place(1.2, 0.03, 0.7, 0.4), LightConditions(gloss=Gloss(0.06, (tilt, 0.0, 1.0)), exposure=1.2))
    pose = Pose(view.rotation, view.position, 1e-8 * np.eye(6), "edges", 40, 0.1)
    cells = CellReader(target, Projection(VGA))
    assert cells.evidence(view.pixels, pose).vouches
    for column, row in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1), (3, 0), (-1, 0), (0, -1)):
        aside = pose.position + target.tags[0].module * np.array([column, row, 0.0])
        assert not cells.evidence(view.pixels, replace(pose, position=aside)).vouches


def test_edges_that_a_highlight_floods_are_not_missed() -> None:
    target = shipped("nested")
    projection = Projection(VGA)
    view = View(target, place(1.2, 0.03, 0.7, 0.4), LightConditions(gloss=Gloss(0.06, (0.1, 0.0, 1.0)), exposure=1.2))
    start = Pose(view.rotation, view.position, 1e-8 * np.eye(6), "edges", 40, 0.1)
    found = EdgeFit(target, projection).fit(view.pixels, start)
    assert found.inliers > 0.9
    assert np.linalg.norm(found.position - view.position) < 0.005
    covered = view.pixels.copy()
    column, row = projection.project(view.position[None])[0][0].astype(int)
    covered[row:, column:] = 255
    found = EdgeFit(target, projection).fit(covered, start)
    assert found is None or found.inliers < 0.9


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


NESTED = shipped("nested")
PROJECTION = Projection(VGA)


def fitted(view: View, pixels: np.ndarray) -> Pose:
    found = EdgeFit(NESTED, PROJECTION).fit(
        pixels, Pose(view.rotation, 1.002 * view.position, 1e-6 * np.eye(6), "edges", 200, 0.05)
    )
    assert found is not None
    return found


def farther(view: View, pixels: np.ndarray) -> float:
    """Error of the range [m]."""
    return float(np.linalg.norm(fitted(view, pixels).position) - np.linalg.norm(view.position))


def lit(view: View, lost: float) -> np.ndarray:
    """The image with less light away from the middle of the target: a share `lost` at 60 px, as behind a mark."""
    middle = PROJECTION.project(view.position[None])[0][0]
    y, x = np.indices(view.pixels.shape)
    light = 1.0 - lost * ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / 60.0**2
    return np.rint(view.pixels * np.clip(light, 0.1, 1.0)).astype(np.uint8)


@pytest.mark.parametrize("distance", [2.2, 2.8, 4.2])
def test_light_that_falls_towards_the_rims_does_not_make_a_print_smaller(distance: float) -> None:
    view = View(NESTED, place(distance, 0.2))
    shares = [farther(view, lit(view, lost)) - farther(view, view.pixels) for lost in (0.2, 0.4)]
    assert np.abs(shares).max() < 0.0004 * distance


def test_light_that_may_move_edges_is_in_the_covariance() -> None:
    view = View(NESTED, place(3.6, 0.2))
    even, uneven = fitted(view, view.pixels), fitted(view, lit(view, 0.5))
    assert uneven.covariance[2, 2] > 2.0 * even.covariance[2, 2]
    # The light of this image moves nothing sideways, that of one with another mark does.
    assert uneven.covariance[0, 0] > 1.35 * even.covariance[0, 0]


def shaded(view: View, pixels: np.ndarray) -> np.ndarray:
    """The image with three tenths of the light on the right of the target."""
    middle = PROJECTION.project(view.position[None])[0][0]
    y, x = np.indices(pixels.shape)
    return np.where(x - middle[0] + 0.3 * (y - middle[1]) > 10.0, np.rint(0.3 * pixels), pixels).astype(np.uint8)


@pytest.mark.parametrize("distance", [2.2, 2.8])
def test_light_that_grows_is_asked_for_beside_a_shadow_too(distance: float) -> None:
    """At a first look a shadow's rim is so far off what even light explains that it seemed to explain nothing."""
    view = View(NESTED, place(distance, 0.2))
    for pixels, grows in ((view.pixels, False), (shaded(view, lit(view, 0.4)), True)):
        located = EdgeFit(NESTED, PROJECTION).locate(pixels, fitted(view, pixels))
        assert ("grown" in located[2]) == grows


@pytest.mark.parametrize("distance", [1.0, 1.2, 1.4])
def test_small_cells_behind_a_tone_curve_do_not_shift_large_ones(distance: float) -> None:
    """One shift for both tags: 0.5 to 0.8 mm."""
    view = View(NESTED, place(distance, 0.2), LightConditions(processing=Processing(gamma=2.2)))
    assert abs(farther(view, view.pixels)) < 0.0004


def test_what_is_known_of_shifts_is_weighed_by_the_edges_of_the_image() -> None:
    """Weighed as in a bad image, 0.1 px held the shift of small cells that are trusted little."""
    line = shifts(np.ones(4), np.array([[True, True, False, False]]))
    assert line.rows.tolist() == [[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]]
    normal, _ = Unknowns([line]).equations(np.zeros(4), np.zeros(4), 0.05**2)
    assert np.diag(normal) == pytest.approx([0.0625, 0.0625])
