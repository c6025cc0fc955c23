"""Fits to edges: what each edge says, where they end and what they claim, hidden, and in light that moves them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.edgefind import FoundEdges, find_edges
from mkdaemon.vision.pose.edgefit import EdgeEvidence, EdgeFit, EdgeStep, shifts
from mkdaemon.vision.pose.edgemodel import EdgeModel, Samples, seen_across
from mkdaemon.vision.pose.gates import CellReader
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import Pose, largest_variance, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import Prior, UnknownRow, Unknowns
from mksim.scene.gloss import Gloss
from mksim.scene.light import Cover, LightConditions
from mksim.scene.processing import NO_PROCESSING, Processing
from mksim.scene.view import view_towards
from tests.vision.views import VGA, PlainView, View, angle_deg, assert_near, place, shipped, start_at

PROJECTION = Projection(VGA)
UNKNOWNS = 7


def step(
    jacobian: np.ndarray,
    offsets: np.ndarray,
    room: np.ndarray | None = None,
    width: float = LIMITS.blur.sharp_px,
    trust: np.ndarray | None = None,
) -> EdgeStep:
    count = len(offsets)
    flat, ones = np.zeros((count, 2)), np.ones(count)
    upright = np.arange(count) % 2 > 0
    samples = Samples(np.arange(count), flat, flat, ones, 30.0 * ones, upright)
    sure, free = ones if trust is None else trust, ones if room is None else room
    edges = FoundEdges(offsets, np.ones(count, dtype=bool), width * ones, sure, free)
    unknowns = Unknowns([UnknownRow("place", jacobian[:, :3].T), UnknownRow("rest", jacobian[:, 3:].T)])
    return EdgeStep(unknowns, samples, edges, 1.0)


def upright_edges(rows: np.ndarray, column: float = 32.0) -> Samples:
    """Samples of an edge at a column, bright to the right, in some rows."""
    count = len(rows)
    places, across = np.column_stack([np.full(count, column), rows]), np.tile([1.0, 0.0], (count, 1))
    return Samples(np.arange(count), places, across, np.full(count, 2.5), np.full(count, 30.0), np.ones(count, bool))


def covariances(errors: np.ndarray, jacobian: np.ndarray, square: np.ndarray, width: float) -> np.ndarray:
    """The position's covariance by the pose of a step, over its true one, for draws of errors `(m, n)`."""
    fitted = [step(jacobian, error, width=width) for error in errors]
    true = np.cov(np.array([one.change[:3] for one in fitted]).T)
    start = Pose(np.eye(3), np.array([0.0, 0.0, 1.0]), np.eye(6), "corners", 4, 0.1)
    prior = Prior(start, None, Projection(VGA), None)
    claimed = [one.pose(prior.begin(), prior, square).covariance[:3, :3] for one in fitted]
    return np.trace(np.linalg.solve(true, np.mean(claimed, axis=0))) / 3


@pytest.mark.parametrize(("kind", "width"), [("own", 3.5), ("shared", LIMITS.blur.sharp_px), ("heavy", 3.5)])
def test_the_covariance_of_a_robust_step_is_that_of_drawn_errors(kind: str, width: float) -> None:
    """Errors of 0.3 px: each sample's own, the same for three neighbours, or a fifth of them four times as large.

    Blur makes errors of edges larger, not more of them the same.
    """
    rng = np.random.default_rng(4)
    square = np.repeat(np.arange(60), 3)
    places = np.repeat(rng.standard_normal((60, UNKNOWNS)), 3, axis=0) + 0.1 * rng.standard_normal((180, UNKNOWNS))
    errors = 0.3 * rng.standard_normal((200, 180))
    if kind == "shared":
        errors = np.repeat(0.3 * rng.standard_normal((200, 60)), 3, axis=1)
    if kind == "heavy":
        errors *= np.where(rng.random(errors.shape) < 0.2, 4.0, 1.0)
    assert 0.7 < covariances(errors, places, square, width) < 1.4


@pytest.mark.parametrize("lacking", ["room", "trust"])
def test_many_doubted_edges_make_none_of_the_others_an_outlier(lacking: str) -> None:
    """Their doubt makes their residuals small: 150 of them set the bound, and 30 large ones lay beyond it."""
    rng = np.random.default_rng(7)
    given = {lacking: np.concatenate([np.ones(30), np.full(150, 0.01)])}
    found = step(rng.standard_normal((180, UNKNOWNS)), 0.1 * rng.standard_normal(180), **given)
    assert np.mean(found.agrees[:30]) > 0.9


def test_an_edge_with_a_rim_of_light_beside_it_is_trusted_less() -> None:
    """Upright edges at column 32, lit evenly above and with a rim three pixels beside it at the bottom."""
    column, rows = np.arange(64), np.arange(4.0, 60.0)
    edge = 40.0 + 120.0 / (1.0 + np.exp(-5.0 * (column - 32.0)))
    rim = 80.0 / (1.0 + np.exp(-5.0 * (column - 35.0)))
    pixels = np.vstack([np.tile(edge, (50, 1)), np.tile(edge + rim, (14, 1))]).astype(np.uint8)
    edges = find_edges(pixels, upright_edges(rows))
    assert edges.found.all()
    assert edges.trust[rows < 48].min() > 0.9
    assert edges.trust[rows > 52].max() < 0.5


def test_an_edge_in_the_shade_is_trusted_less() -> None:
    """A sixth of the light on the lower half; less contrast for all of them, or by clipping, is no shade."""
    edge = np.tile(40.0 + 120.0 / (1.0 + np.exp(-5.0 * (np.arange(64) - 32.0))), (64, 1))
    lower, rows = np.repeat([0.0, 1.0], 32)[:, None], np.arange(4.0, 60.0)
    half, dark, blown = (
        find_edges(np.minimum(grey, 255.0).astype(np.uint8), upright_edges(rows))
        for grey in (edge * (1.0 - 5.0 / 6.0 * lower), edge / 6.0, edge + 150.0 * lower)
    )
    assert half.found.all()
    assert half.trust[rows < 30].min() > 0.9
    assert half.trust[rows > 34].max() < 0.1
    assert dark.trust.min() > 0.9
    moved = blown.light.rows[:2].sum(axis=0)
    assert (blown.trust * (1.0 + (moved / (HALF * LIMITS.edges.located_px)) ** 2)).min() > 0.9


def plain(name: str, *eye: float) -> PlainView:
    """A print without ground, its middle in the middle of the image, seen from a place [m]."""
    return PlainView(shipped(name), view_towards(VGA, np.array(eye), np.zeros(3)))


@pytest.mark.parametrize(("name", "distance", "axis"), [("single", 1.5, 0), ("nested", 0.9, 1), ("nested-36", 1.5, 1)])
def test_a_start_that_is_off_along_one_side_ends_at_the_place(name: str, distance: float, axis: int) -> None:
    view, fitter = plain(name, 0.2 * distance, 0.1 * distance, 0.97 * distance), EdgeFit(shipped(name), PROJECTION)
    for off_px in np.arange(-6.0, 6.1, 2.0):
        off = view.rotation[:, axis] * off_px * distance / VGA.fx
        found = fitter.fit(view.pixels, replace(start_at(view, sd=1.0), position=view.position + off))
        # by one median for all edges most of them end 1-27 cm off, or nowhere
        assert_near(found, view, m=0.0002, inliers=0.95)


def test_a_fit_that_has_not_arrived_says_how_far_it_would_go_on() -> None:
    view = plain("nested", 0.4, 0.2, 1.5)
    start = turn(view.rotation, np.array([0.08, -0.05, 0.0]))
    start = Pose(start, 0.99 * view.position, np.eye(6), "corners", 4, 0.1)
    fitter = EdgeFit(shipped("nested"), PROJECTION)
    broken_off, arrived = (fitter.fit(view.pixels, start, iterations=count) for count in (1, 12))
    off_deg = angle_deg(broken_off.rotation, view.rotation)
    assert largest_variance(arrived.covariance[3:, 3:]) < np.radians(0.1) ** 2
    assert off_deg > 0.5
    assert largest_variance(broken_off.covariance[3:, 3:]) > np.radians(off_deg) ** 2


def slanted(tilt_deg: float, around_deg: float) -> np.ndarray:
    """Direction `(3,)` a print is seen from."""
    tilt, around = np.radians([tilt_deg, around_deg])
    return np.array([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)])


def test_normals_in_the_image_stand_across_edges_and_point_to_the_brighter_side() -> None:
    view, model = plain("nested", *(1.2 * slanted(60.0, 45.0))), EdgeModel.of(shipped("nested"))

    def seen(points: np.ndarray) -> np.ndarray:
        return PROJECTION.project(points @ view.rotation.T + view.position)[0]

    normals, cell_px = seen_across(seen(model.stepped))
    near = 0.01 * model.cell[:, None]
    along = seen(model.points + near * model.tangents) - seen(model.points - near * model.tangents)
    across = seen(model.points + near * model.normals) - seen(model.points - near * model.normals)
    np.testing.assert_allclose((normals * along).sum(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose((normals * normals).sum(axis=1), 1.0)
    height = (normals * across).sum(axis=1) / 0.02
    assert bool((height > 0.0).all())
    np.testing.assert_allclose(cell_px, height, rtol=0.02)
    slant = np.degrees(np.arccos(height * 0.02 / np.linalg.norm(across, axis=1)))
    assert 30.0 < float(np.median(slant)) < 45.0


def strip(side: float, share: float, reflectance: float) -> LightConditions:
    """Something lying over the right side of a tag, its rim parallel to the border."""
    edge, far = side / 2 - share * side, side
    return LightConditions(covers=(Cover(((edge, -far), (far, -far), (far, far), (edge, far)), reflectance),))


@pytest.mark.parametrize(
    ("name", "reflectance", "share"), [("nested", 0.1, 0.3), ("nested", 0.7, 0.05), ("single", 0.3, 0.2)]
)
def test_a_right_pose_is_borne_out_behind_a_cover(name, reflectance, share):
    target = shipped(name)
    view = View(target, place(1.1, 0.35, around=1.0, roll=0.5), strip(target.tags[0].size, share, reflectance))
    fit = EdgeFit(target, PROJECTION)
    fitted = fit.fit(view.pixels, start_at(view, sd=1.0))
    assert_near(fitted, view, deg=0.5)
    assert fit.evidence(view.pixels, fitted).supports


def test_no_wrong_fit_is_borne_out():
    target, rng, wrong = shipped("single"), np.random.default_rng(5), 0
    fit = EdgeFit(target, PROJECTION)
    for k in range(24):
        cover = strip(target.tags[0].size, rng.uniform(0.03, 0.3), rng.uniform(0.05, 0.85))
        view = View(target, place(rng.uniform(0.8, 4.0), rng.uniform(0, 0.7), around=k, roll=k / 2), cover)
        off = turn(view.rotation, rng.normal(0, 0.25, 3))
        start = Pose(off, view.position * rng.uniform(0.92, 1.08), np.eye(6), "edges", 0, 0.0)
        fitted = fit.fit(view.pixels, start)
        if fitted is not None and angle_deg(fitted.rotation, view.rotation) >= 2.0:
            wrong += 1
            found = fit.evidence(view.pixels, fitted)
            assert not found.supports, (k, found)
    assert wrong >= 2


def test_nothing_is_borne_out_where_there_is_no_target():
    target = shipped("single")
    view, fit = View(target, place(1.0, 0.2)), EdgeFit(target, PROJECTION)
    pose = start_at(view, sd=1.0)
    assert not EdgeEvidence().supports
    assert fit.evidence(np.full((480, 640), 90, np.uint8), pose) == EdgeEvidence()
    noise = np.random.default_rng(1).integers(0, 255, (480, 640)).astype(np.uint8)
    assert not fit.evidence(noise, pose).supports
    assert fit.evidence(view.pixels, replace(pose, position=np.array([9.0, 0.0, 1.0]))) == EdgeEvidence()


NESTED = shipped("nested")
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
    rise = 150.0 * blurred + growing * (np.arange(64) - EDGE_AT)
    rows = np.vstack([np.tile(50.0 + rise, (32, 1)), np.tile(255.0 - 150.0 * seen + rise, (32, 1))])
    return find_edges(np.clip(np.rint(rows), 0, 255).astype(np.uint8), upright_edges(np.linspace(2.0, 61.0, 60)))


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


def flooded_view(sun: float) -> View:
    """A print from nearly above, its ink under a highlight as bright as its paper."""
    return View(NESTED, place(1.2, 0.03, 0.7, 0.4), LightConditions(gloss=Gloss(0.06, (sun, 0.0, 1.0)), exposure=1.2))


@pytest.mark.parametrize("sun", [0.0, 0.06])
def test_cells_that_a_highlight_floods_contradict_no_pose_and_the_others_do(sun: float) -> None:
    view = flooded_view(sun)
    pose, cells = start_at(view, sd=1e-4), CellReader(NESTED, PROJECTION)
    assert cells.evidence(view.pixels, pose).vouches
    for column, row in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1), (3, 0), (-1, 0), (0, -1)):
        aside = pose.position + NESTED.tags[0].module * np.array([column, row, 0.0])
        assert not cells.evidence(view.pixels, replace(pose, position=aside)).vouches


SINGLE = shipped("single")
GAMMA, WEBCAM = Processing(gamma=2.2), Processing(gamma=2.2, sharpening=0.8)


def toned(distance: float, processing: Processing) -> PlainView:
    """A print in light that is processed."""
    conditions = LightConditions(vignetting=0.0, noise_sd=0.5, shot_gain=0.0, processing=processing)
    return PlainView(SINGLE, view_towards(VGA, distance * np.array([0.3, 0.2, 0.93]), np.zeros(3)), conditions)


@pytest.mark.parametrize(
    ("kind", "distance", "processing"),
    [
        *((EdgeFit, 1.0, tone) for tone in (NO_PROCESSING, GAMMA, WEBCAM)),
        *((PhotoFit, 8.0, tone) for tone in (NO_PROCESSING, GAMMA)),
    ],
)
def test_the_range_is_right_under_any_tone_curve(kind, distance: float, processing: Processing) -> None:
    """Without the common shift of edges 0.3 and 0.6 % off under gamma, without the term in grey values 0.5 %."""
    view = toned(distance, processing)
    found = kind(SINGLE, PROJECTION).fit(view.pixels, start_at(view, nearer=1.003, sd=1.0))
    farther = found.range_m / np.linalg.norm(view.position) - 1.0
    assert abs(farther) < (0.001 if kind is EdgeFit else 0.002)
    assert kind is PhotoFit or (found.shift_px < -0.15) == (processing is not NO_PROCESSING)


def fitted(view: View, pixels: np.ndarray) -> Pose:
    return EdgeFit(NESTED, PROJECTION).fit(pixels, start_at(view, nearer=1.002))


def farther(view: View, pixels: np.ndarray) -> float:
    """Error of the range [m]."""
    return float(np.linalg.norm(fitted(view, pixels).position) - np.linalg.norm(view.position))


def lit(view: View, lost: float) -> np.ndarray:
    """The image with less light away from the middle of the target: a share `lost` at 60 px, as behind a mark."""
    middle = PROJECTION.project(view.position[None])[0][0]
    y, x = np.indices(view.pixels.shape)
    light = 1.0 - lost * ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / 60.0**2
    return np.rint(view.pixels * np.clip(light, 0.1, 1.0)).astype(np.uint8)


def test_light_that_falls_towards_the_rims_makes_no_print_smaller_and_is_in_the_covariance() -> None:
    view = View(NESTED, place(3.6, 0.2))
    shares = [farther(view, lit(view, lost)) - farther(view, view.pixels) for lost in (0.2, 0.4)]
    assert np.abs(shares).max() < 0.0004 * 3.6
    even, uneven = fitted(view, view.pixels), fitted(view, lit(view, 0.5))
    assert uneven.covariance[2, 2] > 2.0 * even.covariance[2, 2]
    # The light of this image moves nothing sideways, that of one with another mark does.
    assert uneven.covariance[0, 0] > 1.35 * even.covariance[0, 0]


def test_what_is_known_of_shifts_is_weighed_by_the_edges_of_the_image() -> None:
    """Weighed as in a bad image, 0.1 px held the shift of small cells that are trusted little."""
    line = shifts(np.ones(4), np.array([[True, True, False, False]]))
    assert line.rows.tolist() == [[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]]
    normal, _ = Unknowns([line]).equations(np.zeros(4), np.zeros(4), 0.05**2)
    assert np.diag(normal) == pytest.approx([0.0625, 0.0625])
