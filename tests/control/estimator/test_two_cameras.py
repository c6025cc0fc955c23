"""Two cameras over one target: each pose counts by its own covariance and time, and one of them may die."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest

from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import P
from mkdaemon.control.estimator.rollback import STEP
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
            estimator.target_seen(seen)
        if estimator is not None and k % 2 == 0:
            estimator.attitude_received(plant.now, *plant.reported(), plant.yaw + 0.4)
            sway = round(4 * math.sin(2.0 * plant.now))
            estimator.sent(plant.stick(sway, -sway))
        if estimator is not None and k % 5 == 0 and plant.now > SETTLED:
            estimate = estimator.estimate(plant.now)
            found.append(estimate.position - np.array([*plant.axes[:, P], 2.0]))
        plant.step()
    assert estimator is not None
    return np.array(found), estimator


def rms(found: npt.NDArray[np.float64]) -> float:
    return float(np.sqrt((found**2).mean()))


def test_two_equal_cameras_are_better_than_one() -> None:
    one, _ = errors(replace(SHARP, sd=0.05))
    both, estimator = errors(replace(SHARP, sd=0.05), replace(SHARP, sd=0.05, delay=11))
    assert rms(both) < 0.85 * rms(one)
    assert estimator.rejected == 0


def test_a_coarse_late_camera_does_not_spoil_a_sharp_one() -> None:
    sharp, _ = errors(SHARP)
    both, _ = errors(SHARP, COARSE)
    assert rms(both) < 1.05 * rms(sharp)


@pytest.mark.parametrize("dies", [0, 1])
def test_when_one_of_two_cameras_dies_the_estimate_goes_on(dies: int) -> None:
    cameras = [replace(camera, dies=2.5 if k == dies else math.inf) for k, camera in enumerate([SHARP, COARSE])]
    found, estimator = errors(*cameras)
    left, _ = errors(COARSE if dies == 0 else SHARP)
    late = len(found) // 2
    assert rms(found[late:]) < 1.1 * rms(left[late:])
    assert estimator.estimate(4.5).age < 0.3
