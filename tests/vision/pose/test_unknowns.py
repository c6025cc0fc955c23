"""One table of unknowns: what a step is solved from, what is known beforehand, and where a fit is after it."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.vision.arrays import UnknownsEstimate
from mkdaemon.vision.pose.pose import Pose, angle_between, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import Shutter
from mkdaemon.vision.pose.unknowns import RIDGE, Prior, TargetLevel, UnknownRow, Unknowns
from tests.vision.views import VGA

RNG = np.random.default_rng(3)
PLACE = np.array([0.1, -0.2, 1.5])
START = Pose(turn(np.eye(3), np.array([3.0, 0.1, 0.2])), PLACE, np.eye(6), "corners", 4, 0.1)
STILL = Projection(VGA)
POINTS, SLOPES = (np.asfortranarray(RNG.standard_normal((40, 3))) for _ in range(2))


def test_a_step_is_least_squares_with_what_is_known_as_further_measurements() -> None:
    rows, weights, measured = RNG.standard_normal((5, 40)), RNG.random(40), RNG.standard_normal(40)
    root = RNG.standard_normal((3, 3))
    off, sd = RNG.standard_normal(3), np.array([0.5, 2.0])
    table = [UnknownRow("place", rows[:3], root.T @ root, off), UnknownRow("shift", rows[3:], sd**-2)]
    unknowns = Unknowns(table)
    step = np.linalg.solve(*unknowns.equations(weights, measured, 0.09))
    known = 0.3 * np.block([[root, np.zeros((3, 2))], [np.zeros((2, 3)), np.diag(1.0 / sd)]])
    left = np.vstack([np.sqrt(weights)[:, None] * rows.T, known])
    right = np.concatenate([np.sqrt(weights) * measured, known @ np.concatenate([off, np.zeros(2)])])
    np.testing.assert_allclose(step, np.linalg.lstsq(left, right, rcond=None)[0], rtol=1e-6)
    assert unknowns.surprise == pytest.approx(float(((root @ off) ** 2).sum()))
    assert (unknowns["shift"], unknowns.carried) == (slice(3, 5), 3)
    assert "motion" not in unknowns


def test_a_level_turns_a_target_upright_where_an_image_says_little() -> None:
    up = START.rotation[:, 2] + np.array([0.02, -0.01, 0.0])
    up /= np.linalg.norm(up)
    prior = Prior(START, TargetLevel(up, 0.01), STILL, None)
    state = prior.begin()
    unknowns = Unknowns(prior.table(state, SLOPES, POINTS, np.zeros(40), None))
    change = np.linalg.solve(*unknowns.equations(np.full(40, 1e-3), np.zeros(40), 1.0))
    moved = state.moved(unknowns, change)
    np.testing.assert_allclose(moved.rotation[:, 2], up, atol=1e-3)
    assert angle_between(moved.rotation, START.rotation) == pytest.approx(
        float(np.arccos(up @ START.rotation[:, 2])), rel=0.01
    )


def test_what_an_image_says_of_a_motion_is_without_what_was_known_of_it() -> None:
    known = UnknownsEstimate(np.array([0.1, 0.2, -0.1, 0.3]), 0.5**2 * np.eye(4))
    shutter = Shutter(None, 100.0)
    asked = shutter.motion(known)
    start = Pose(START.rotation, PLACE, np.eye(6), "corners", 4, 0.1, known_motion=known)
    prior = Prior(start, None, Projection(VGA, shutter), None)
    state = prior.begin()
    unknowns = Unknowns(prior.table(state, SLOPES, POINTS, RNG.standard_normal(40), None))
    image = np.diag([1.0, 2.0, 3.0, 4.0])
    covariance = np.eye(len(unknowns.rows))
    covariance[unknowns["motion"], unknowns["motion"]] = np.linalg.inv(image + asked.information)
    seen = prior.seen_motion(state, unknowns, covariance)
    np.testing.assert_allclose(seen.information, image, atol=2.0 * RIDGE)
    np.testing.assert_allclose(image @ seen.mean, -asked.information @ asked.mean, rtol=2.0 * RIDGE)
    assert Prior(START, None, Projection(VGA, Shutter(30e-6)), None).seen_motion(state, unknowns, covariance) is None


@pytest.mark.parametrize(
    ("place", "ran"),
    [((0.1, -0.2, 1.5), False), ((0.1, -0.2, 1.9), True), ((0.0, 0.0, -1.0), True), ((np.nan,) * 3, True)],
)
def test_a_fit_that_leaves_the_neighbourhood_of_its_start_ran_away(place: tuple[float, ...], ran: bool) -> None:
    begun = Prior(Pose(START.rotation, np.array(place), np.eye(6), "corners", 4, 0.1), None, STILL, None).begin()
    assert begun.ran_away(START) is ran
