"""A camera or source that is found wrong: the estimate goes on as if it had shown nothing lately."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.control.estimator.cameras import Cameras
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.rollback import STEP, Measurement
from tests.control.estimator.test_placed import view
from tests.control.estimator.test_rollback import POSITION, make, readings, run

PERIOD = 0.03


@pytest.mark.parametrize("seed", range(5))
def test_what_a_source_measured_is_undone_with_its_effect_on_the_covariance(seed):
    rng = random.Random(seed)
    right, wrong = readings(rng), [replace(each, source="mocap") for each in readings(rng, 20)]
    fooled = run(right + wrong, lambda measurement: STEP)
    alone = run(right, lambda measurement: STEP)
    assert not np.allclose(fooled.states, alone.states, atol=1e-6)
    fooled.forget("mocap")
    assert np.allclose(fooled.states, alone.states, atol=1e-9)
    assert np.allclose(fooled.covariances, alone.covariances, atol=1e-12)


def test_what_the_filter_doubts_of_itself_outlasts_what_it_forgets():
    filter_ = run(readings(random.Random(1)), lambda measurement: STEP)
    filter_.measure(Measurement(0.35, POSITION, np.array([0.3, 1.7]), 4e-4, source="mocap"))
    filter_.measure(Measurement(0.4, POSITION, np.array([3.4, 4.6]), 4e-4, source="down"), np.diag([4.0, 0.0]))
    moved = filter_.states.copy()
    filter_.forget("mocap")
    assert np.allclose(filter_.states, moved, atol=0.05)


def test_who_measured_nothing_is_forgotten_without_a_trace():
    filter_ = run(readings(random.Random(1)), lambda measurement: STEP)
    before = filter_.states.copy()
    filter_.forget("mocap")
    assert np.array_equal(filter_.states, before)
    make().forget("mocap")


def test_the_image_that_shows_another_camera_to_be_wrong_names_it():
    cameras = Cameras(patience=2)
    for camera, is_placed in (("down", False), ("mocap", True)):
        cameras.seen(camera, 1.0, is_placed=is_placed)
    assert cameras.judged("mocap", is_refused=False) == ()
    assert cameras.judged("down", is_refused=True) == ()
    assert cameras.judged("down", is_refused=True) == ("mocap",)
    assert cameras.judged("down", is_refused=True) == (), "once"


def sinking(t):
    """Height [m] of an aircraft that begins to sink, and its climb rate [m/s]."""
    since = max(0.0, t - 1.5)
    return 1.5 - 0.75 * since**2, -1.5 * since


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_late_source_does_not_throw_the_climb_rate_when_the_camera_outvotes_it(seed):
    """What the source had measured last stayed in the estimate beside the images: 3 m/s upwards."""
    noise = random.Random(seed)
    estimator, wrong = Estimator(AircraftModel(), view(0.0, (0.0, 0.0, 1.5)), 118.0, compass=0.3), []
    for k in range(1, 75):
        at = k * PERIOD
        estimator.attitude_received(at - 0.01, 0.0, 0.0, 0.3)
        estimator.target_seen(view(at, (0.0, 0.0, sinking(at - 0.4)[0])), at)
        exposed, blur = at - 0.075, noise.gauss(0.0, 0.01)
        seen = (0.0, 0.0, sinking(exposed)[0] + blur)
        estimator.target_seen(view(exposed, seen, camera="down", is_placed=False, sd=0.01), at)
        wrong.append(abs(float(estimator.estimate(at).velocity[2]) - sinking(at)[1]))
    assert estimator.contradicting == ("mocap",)
    assert max(wrong) < 1.0
    assert estimator.estimate(at).position[2] == pytest.approx(sinking(at)[0], abs=0.05)
