"""One table of unknowns, and the bend of a print among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.vision.arrays import UnknownsEstimate
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import Shutter
from mkdaemon.vision.pose.unknowns import RIDGE, Prior, UnknownRow, Unknowns
from mkdaemon.vision.track.follower import LearnedBend
from mksim.scene.curl import Curl
from mksim.scene.light import LightConditions
from tests.vision.views import VGA, View, angle_deg, assert_near, nees, place, shipped, start_at

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


TARGET = replace(shipped("nested"), bend=0.01)
"""On paper that lies by itself."""
FLAT = replace(TARGET, bend=0.0)
SIDE = TARGET.tags[0].size
RISE = 0.01
PROJECTION = Projection(VGA)


def curled(axis: float) -> tuple[LightConditions, np.ndarray]:
    """A print bent about an axis, its middle up by 1 % of the side, and the rise that is."""
    across = np.array([-np.sin(axis), np.cos(axis)])
    rise = -RISE * np.array([across[0] ** 2, 2 * across[0] * across[1], across[1] ** 2])
    return LightConditions(curl=Curl(SIDE / (8 * RISE), axis, 1.4 * SIDE)), rise


@pytest.mark.parametrize("axis", [0.0, 2.2])
def test_a_bend_is_found_and_not_taken_for_a_tilt(axis: float) -> None:
    conditions, rise = curled(axis)
    view = View(TARGET, place(1.2, 0.4, around=0.5), conditions)
    start = start_at(view, nearer=1.002)
    found, flat = (EdgeFit(target, PROJECTION).fit(view.pixels, start) for target in (TARGET, FLAT))
    assert np.abs(found.bend.mean - rise).max() < 0.15 * RISE
    assert_near(found, view, deg=min(0.1, 0.3 * angle_deg(flat.rotation, view.rotation)), claims=4.0)
    assert nees(view, flat) > 5.0


def learning(sd: float) -> tuple[UnknownsEstimate, LearnedBend, Pose]:
    """What a file expects of a bend, a knowledge that begins with it, and a near pose that found a rise of 1 %."""
    prior = UnknownsEstimate(np.zeros(3), sd**2 * np.eye(3))
    told = UnknownsEstimate(np.array([0.01, 0.0, 0.0]), 1e-8 * np.eye(3))
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 1.0]), np.eye(6), "edges", 200, 0.05, bend=told, known_bend=prior)
    return prior, LearnedBend(prior), pose


def test_what_near_edges_told_is_forgotten_within_minutes() -> None:
    prior, learned, pose = learning(0.01)
    learned.learn(0.0, replace(pose, source="photometric"))
    assert learned.at(0.1).mean[0] == 0.0
    learned.learn(0.0, pose)
    soon, late = learned.at(1.0), learned.at(3000.0)
    assert soon.mean[0] == pytest.approx(0.01, rel=0.01)
    assert soon.covariance[0, 0] < 2e-6
    assert late.mean[0] == pytest.approx(0.0, abs=1e-6)
    assert late.covariance == pytest.approx(prior.covariance, rel=1e-3)


def test_a_bend_that_an_image_contradicts_is_learned_anew() -> None:
    prior, learned, pose = learning(0.01)
    learned.learn(0.0, pose)
    moved = replace(pose.bend, mean=pose.bend.mean + np.array([0.0, 5e-4, 0.0]))
    learned.learn(0.1, replace(pose, bend=moved, known_bend=pose.bend))
    assert learned.at(0.1).covariance == pytest.approx(prior.covariance)
