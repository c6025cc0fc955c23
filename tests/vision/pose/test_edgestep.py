"""What edges that disagree, or share their errors, do to a pose and to its covariance."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.edgefind import FoundEdges, find_edges
from mkdaemon.vision.pose.edgefit import EdgeFit, EdgeStep
from mkdaemon.vision.pose.edgemodel import Samples
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import Prior, UnknownRow, Unknowns
from mksim.scene.light import LightConditions
from mksim.scene.shadows import LeafShadow
from tests.vision.views import VGA, View, angle_deg, place, shipped

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


def upright_edges() -> tuple[np.ndarray, Samples]:
    """Rows `(56,)` and samples at column 32, bright to the right."""
    rows = np.arange(4.0, 60.0)
    count = len(rows)
    return rows, Samples(
        np.arange(count),
        np.column_stack([np.full(count, 32.0), rows]),
        np.tile([1.0, 0.0], (count, 1)),
        np.full(count, 2.5),
        np.full(count, 30.0),
        np.ones(count, dtype=bool),
    )


def covariances(errors: np.ndarray, jacobian: np.ndarray, square: np.ndarray, width: float) -> np.ndarray:
    """The position's covariance by the pose of a step, over its true one, for draws of errors `(m, n)`."""
    fitted = [step(jacobian, error, width=width) for error in errors]
    true = np.cov(np.array([one.change[:3] for one in fitted]).T)
    start = Pose(np.eye(3), np.array([0.0, 0.0, 1.0]), np.eye(6), "corners", 4, 0.1)
    prior = Prior(start, None, Projection(VGA), None)
    claimed = [one.pose(prior.begin(), prior, square).covariance[:3, :3] for one in fitted]
    return np.trace(np.linalg.solve(true, np.mean(claimed, axis=0))) / 3


@pytest.mark.parametrize("width", [LIMITS.blur.sharp_px, 3.5])
@pytest.mark.parametrize("kind", ["own", "shared", "heavy"])
def test_the_covariance_of_a_robust_step_is_that_of_drawn_errors(kind: str, width: float) -> None:
    """Errors of 0.3 px: each sample's own, the same for three neighbours, or a fifth of them four times as large.

    Blur makes errors of edges larger, not more of them the same.
    """
    rng = np.random.default_rng(4)
    square = np.repeat(np.arange(60), 3)
    places = np.repeat(rng.standard_normal((60, UNKNOWNS)), 3, axis=0) + 0.1 * rng.standard_normal((180, UNKNOWNS))
    errors = 0.3 * rng.standard_normal((300, 180))
    if kind == "shared":
        errors = np.repeat(0.3 * rng.standard_normal((300, 60)), 3, axis=1)
    if kind == "heavy":
        errors *= np.where(rng.random(errors.shape) < 0.2, 4.0, 1.0)
    assert 0.7 < covariances(errors, places, square, width) < 1.4


def test_what_few_squares_share_is_in_the_covariance_though_the_fit_gives_way_to_it() -> None:
    """Twelve squares of nine samples with one error each: seven unknowns take up much of it."""
    rng = np.random.default_rng(5)
    square = np.repeat(np.arange(12), 9)
    places = np.repeat(rng.standard_normal((12, UNKNOWNS)), 9, axis=0) + 0.5 * rng.standard_normal((108, UNKNOWNS))
    errors = np.repeat(0.3 * rng.standard_normal((400, 12)), 9, axis=1) + 0.03 * rng.standard_normal((400, 108))
    assert 0.8 < covariances(errors, places, square, LIMITS.blur.sharp_px) < 1.3


def test_doubt_of_some_edges_makes_no_other_one_disagree() -> None:
    """Their weighed residuals are small: they would set a bound beyond which the others lie."""
    rng = np.random.default_rng(9)
    trust = np.where(np.arange(180) < 120, 0.02, 1.0)
    found = step(rng.standard_normal((180, UNKNOWNS)), 0.1 * rng.standard_normal(180), trust=trust)
    assert np.mean(found.agrees) > 0.95


def test_many_edges_without_room_make_none_that_have_it_an_outlier() -> None:
    """Their doubt makes their residuals small: 150 of them set the bound, and 30 large ones lay beyond it."""
    rng = np.random.default_rng(7)
    room = np.concatenate([np.ones(30), np.full(150, 0.01)])
    found = step(rng.standard_normal((180, UNKNOWNS)), 0.1 * rng.standard_normal(180), room)
    assert np.mean(found.agrees[:30]) > 0.9


def test_an_edge_with_a_rim_of_light_beside_it_is_trusted_less() -> None:
    """Upright edges at column 32, lit evenly above and with a rim three pixels beside it at the bottom."""
    column = np.arange(64)
    edge = 40.0 + 120.0 / (1.0 + np.exp(-5.0 * (column - 32.0)))
    rim = 80.0 / (1.0 + np.exp(-5.0 * (column - 35.0)))
    pixels = np.vstack([np.tile(edge, (50, 1)), np.tile(edge + rim, (14, 1))]).astype(np.uint8)
    rows, samples = upright_edges()
    edges = find_edges(pixels, samples)
    assert edges.found.all()
    assert edges.trust[rows < 48].min() > 0.9
    assert edges.trust[rows > 52].max() < 0.5


def test_an_edge_in_the_shade_is_trusted_less() -> None:
    """A sixth of the light on the lower half; less contrast for all of them, or by clipping, is no shade."""
    edge = np.tile(40.0 + 120.0 / (1.0 + np.exp(-5.0 * (np.arange(64) - 32.0))), (64, 1))
    lower = np.repeat([0.0, 1.0], 32)[:, None]
    rows, samples = upright_edges()
    half, dark, blown = (
        find_edges(np.minimum(grey, 255.0).astype(np.uint8), samples)
        for grey in (edge * (1.0 - 5.0 / 6.0 * lower), edge / 6.0, edge + 150.0 * lower)
    )
    assert half.found.all()
    assert half.trust[rows < 30].min() > 0.9
    assert half.trust[rows > 34].max() < 0.1
    assert dark.trust.min() > 0.9
    moved = blown.light.rows[:2].sum(axis=0)
    assert (blown.trust * (1.0 + (moved / (HALF * LIMITS.edges.located_px)) ** 2)).min() > 0.9


def test_leaf_shadows_leave_a_pose_that_its_covariance_allows() -> None:
    """Leaves throw rims as narrow as the target's cells over all of it: 12 views at 3.5 to 4.5 m."""
    target = shipped("nested")
    fit = EdgeFit(target, PROJECTION)
    rng = np.random.default_rng(8)
    nees, turned = [], []
    for k in range(0, 24, 2):
        sky = LightConditions(leaves=LeafShadow(k, shift=(0.05 * k, 0.0)))
        view = View(target, place(3.5 + k / 24, 0.05 + 0.01 * k, around=0.9 * k, roll=0.7 * k), sky)
        start = turn(view.rotation, np.radians(0.7) * rng.standard_normal(3))
        found = fit.fit(view.pixels, Pose(start, view.position, np.eye(6), "corners", 8, 0.1))
        error = np.concatenate([found.position - view.position, rotation_vector(found.rotation @ view.rotation.T)])
        nees.append(error @ np.linalg.solve(found.covariance, error) / 6)
        turned.append(angle_deg(found.rotation, view.rotation))

    assert np.mean(nees) < 2.0
    assert np.median(turned) < 0.7


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    skewed = (rotation - rotation.T) / 2
    return np.array([skewed[2, 1], skewed[0, 2], skewed[1, 0]])
