"""Fits to edges: what they begin with, what each edge says, where they end, and what they claim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.edgefind import FoundEdges, find_edges
from mkdaemon.vision.pose.edgefit import EdgeFit, EdgeStep
from mkdaemon.vision.pose.edgemodel import EdgeModel, Samples, seen_across
from mkdaemon.vision.pose.pose import Pose, largest_variance, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import Prior, UnknownRow, Unknowns
from mksim.scene.light import LightConditions
from mksim.scene.view import view_towards
from tests.vision.views import VGA, PlainView, angle_deg, assert_near, shipped, start_at

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


@pytest.mark.parametrize(("name", "tilt", "around"), [("single", 58.0, 45.0), ("nested", 45.0, 30.0)])
def test_a_slanted_view_onto_a_corner_ends_at_the_place(name: str, tilt: float, around: float) -> None:
    view, fitter = plain(name, *(1.2 * slanted(tilt, around))), EdgeFit(shipped(name), PROJECTION)
    for off in 0.015 * np.vstack([np.eye(3), -np.eye(3)]):
        start = Pose(turn(view.rotation, off), 1.003 * view.position, np.eye(6), "corners", 4, 0.1)
        # 0.1-1 degree along the normals of the print
        assert_near(fitter.fit(view.pixels, start), view, deg=0.03, claims=4.0)


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


def test_no_edge_of_the_outer_tag_has_the_paper_of_the_inner_one_within_half_a_cell() -> None:
    """Then all edges of a plain nested target agree: 0.957 of them with the edges beside the inner tag's paper."""
    target = shipped("nested")
    model, (outer, inner) = EdgeModel.of(target), target.tags
    own = model.tag == 0
    beside = 0.5 * outer.module * model.normals[own]
    for points in (model.points[own] - beside, model.points[own], model.points[own] + beside):
        assert not bool((np.abs(points[:, :2]).max(axis=1) <= inner.paper / 2).any())
    assert int(own.sum()) > 0.75 * len(EdgeModel.of(shipped("single")).points)
    for distance in (1.8, 2.5, 3.5):
        seen = view_towards(VGA, distance * np.array([0.2, 0.1, 0.97]), np.zeros(3))
        view = PlainView(target, seen, LightConditions())
        assert EdgeFit(target, PROJECTION).fit(view.pixels, start_at(view, sd=1.0)).inliers > 0.985
