"""Two cameras over one target: each pose counts by its own covariance and time, and one of them may die."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import P, T
from mkdaemon.control.estimator.rollback import STEP
from mkdaemon.control.estimator.tuning import ROBUST
from mkdaemon.control.estimator.values import TargetView
from tests.control.estimator.test_estimator import HOVER, MODEL, Plant, view

SETTLED = 1.5
"""From here errors count [s]."""


@dataclass(frozen=True)
class Camera:
    """Sees the target every `period` steps, `delay` steps late, with an error of `sd` [m], until `dies` [s]."""

    period: int
    delay: int
    sd: float
    dies: float = math.inf


SHARP = Camera(period=3, delay=6, sd=0.02)
COARSE = Camera(period=5, delay=20, sd=0.1)


def noisy(true: TargetView, sd: float, rng: np.random.Generator) -> TargetView:
    covariance = np.diag([sd**2] * 3 + [0.01**2] * 3)
    return replace(true, position_flu=true.position_flu + sd * rng.standard_normal(3), covariance=covariance)


@lru_cache
def errors(*cameras: Camera) -> tuple[npt.NDArray[np.float64], Estimator]:
    """Position errors (n, 3) of a flight of 4.5 s that sways, every 50 ms."""
    plant, estimator, pending = Plant(yaw=0.4), None, list[tuple[int, TargetView]]()
    streams = [np.random.default_rng([5, k]) for k in range(len(cameras))]
    found = []
    for k in range(round(4.5 / STEP)):
        for camera, rng in zip(cameras, streams, strict=True):
            if k % camera.period == 0 and plant.now < camera.dies:
                seen = noisy(view(plant.now, plant.axes, 2.0, plant.yaw), camera.sd, rng)
                pending.append((k + camera.delay, seen))
        for _, seen in (due for due in pending if due[0] == k):
            if estimator is None:
                estimator = Estimator(MODEL, seen, HOVER)
            estimator.advance(plant.now)
            estimator.target_seen(seen, plant.now)
        if estimator is not None and k % 2 == 0:
            sway(plant, estimator)
        if estimator is not None and k % 5 == 0 and plant.now > SETTLED:
            estimate = estimator.estimate(plant.now)
            found.append(estimate.position - np.array([*plant.axes[:, P], 2.0]))
        plant.step()
    assert estimator is not None
    return np.array(found), estimator


def sway(plant: Plant, estimator: Estimator) -> None:
    """Report the attitude of a moment and move the sticks."""
    estimator.attitude_received(plant.now, *plant.reported(), plant.yaw + 0.4)
    counts = round(4 * math.sin(2.0 * plant.now))
    estimator.sent(plant.stick(counts, -counts))


def rms(found: npt.NDArray[np.float64]) -> float:
    return float(np.sqrt((found**2).mean()))


@pytest.mark.parametrize(
    ("first", "second", "share"),
    [(replace(SHARP, sd=0.05), replace(SHARP, sd=0.05, delay=11), 0.85), (SHARP, COARSE, 1.05)],
    ids=["two equal ones are better than one", "a coarse late one does not spoil a sharp one"],
)
def test_a_second_camera_helps_or_does_no_harm(first: Camera, second: Camera, share: float) -> None:
    one, _ = errors(first)
    both, estimator = errors(first, second)
    assert rms(both) < share * rms(one)
    assert estimator.rejected == 0


def test_when_one_of_two_cameras_dies_the_estimate_goes_on() -> None:
    found, estimator = errors(replace(SHARP, dies=2.5), COARSE)
    left, _ = errors(COARSE)
    late = len(found) // 2
    assert rms(found[late:]) < 1.1 * rms(left[late:])
    assert estimator.estimate(4.5).age < 0.3


def displaced(true: TargetView, by: float) -> TargetView:
    """What a camera shows whose lens sits elsewhere on the vehicle than its file says, to the right [m]."""
    return replace(true, position_flu=true.position_flu + np.array([0.0, by, 0.0]))


def fly(*cameras: tuple[str, int, float, int], seconds: float = 4.0) -> tuple[npt.NDArray[np.float64], Estimator]:
    """Errors (n, 3) of a flight; each camera has a name, a period in steps, a wrong place [m] and a first step."""
    plant, estimator = Plant(yaw=0.4), None
    rng, found = np.random.default_rng(8), []
    for k in range(round(seconds / STEP)):
        for name, period, wrong, first in cameras:
            if k % period == 0 and k >= first:
                true = noisy(view(plant.now, plant.axes, 2.0, plant.yaw), 0.01, rng)
                seen = replace(displaced(true, wrong), camera=name)
                estimator = estimator or Estimator(MODEL, seen, HOVER)
                estimator.advance(plant.now)
                estimator.target_seen(seen, plant.now)
        if estimator is not None and k % 2 == 0:
            sway(plant, estimator)
            if plant.now > SETTLED:
                found.append(estimator.estimate(plant.now).position - np.array([*plant.axes[:, P], 2.0]))
        plant.step()
    assert estimator is not None
    return np.array(found), estimator


WRONG = 0.3
"""[m]."""


def test_a_camera_that_contradicts_another_is_left_out_however_fast_it_is() -> None:
    found, estimator = fly(("down", 6, 0.0, 0), ("forward", 1, WRONG, 200))
    assert rms(found) < 0.02
    assert estimator.contradicting == ("forward",)
    assert estimator.innovation < 1.5


def test_most_cameras_are_right() -> None:
    found, estimator = fly(("down", 3, WRONG, 0), ("left", 3, 0.0, 1), ("right", 3, 0.0, 2))
    assert estimator.contradicting == ("down",)
    assert rms(found) < 0.02


def test_a_camera_that_was_found_wrong_is_not_believed_when_it_is_left_alone() -> None:
    """A flight by it ends as one whose target is out of sight; what was known of it does not end with the other's."""
    plant = Plant(yaw=0.4)
    first = replace(view(plant.now, plant.axes, 2.0, plant.yaw), camera="down")
    estimator = Estimator(MODEL, first, HOVER)
    for k in range(300):
        plant.step()
        estimator.advance(plant.now)
        if k % 3 == 0:
            seen = replace(view(plant.now, plant.axes, 2.0, plant.yaw), camera="forward")
            if k > 100:
                estimator.target_seen(displaced(seen, WRONG), plant.now)
            if k < 130:
                estimator.target_seen(replace(seen, camera="down"), plant.now)
        if k == 130:
            assert estimator.contradicting == ("forward",)
    assert estimator.contradicting == ("forward",)
    assert estimator.estimate(plant.now).age > 1.5


def test_the_attitude_in_two_poses_of_one_moment_counts_once() -> None:
    tilts = []
    for names in (("down",), ("down", "forward"), ("down", "forward", "back")):
        plant, estimator = Plant(yaw=0.0), None
        for k in range(60):
            plant.step()
            if k % 3:
                continue
            for name in names:
                seen = replace(view(plant.now, plant.axes, 2.0, plant.yaw), camera=name)
                estimator = estimator or Estimator(MODEL, seen, HOVER, nominal=ROBUST)  # caution changes nothing
                estimator.advance(plant.now)
                vague = np.diag([100.0] * 3 + [1e-4] * 3)  # nothing but the tilt
                estimator.target_seen(replace(seen, covariance=vague), plant.now)
        assert estimator is not None
        tilts.append(float(estimator._level.covariances[0, T, T]))
    assert tilts == pytest.approx([tilts[0]] * 3, rel=0.15)
