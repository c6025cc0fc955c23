"""Landing: what it takes to say that the feet stand."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.control.estimator.values import Estimate
from mkdaemon.control.manoeuvres.land import LARGEST_CUSHION, Fall, Landing, LandingLimits, LandingPhase

LIMITS = LandingLimits()
STEP = 0.02


def estimate(at, height, *, climb=-0.28, age=0.1, sd=0.01, thrust=0.81, east=0.0):
    """The aircraft with its feet at a height [m] over the target."""
    vertical = np.array([height + LIMITS.stand_height, climb, thrust - 1.0, 0.0])
    return Estimate(
        at=at,
        position=np.array([east, 0.0, height + LIMITS.stand_height]),
        velocity=np.array([0.0, 0.0, climb]),
        tilt=np.zeros(2),
        disturbance=np.zeros(2),
        yaw=0.0,
        hover_gas=125.0,
        axes=np.zeros((2, 9)),
        vertical=vertical,
        position_sd=np.array([0.01, 0.01, sd]),
        age=age,
    )


def land(heights, **fields):
    """Feed heights, one a step; returns the landing and when it was over [s]."""
    landing = Landing(LIMITS, estimate(0.0, heights[0]))
    for k, height in enumerate(heights):
        landing.goal(estimate(k * STEP, height, **fields), None, STEP)
    return landing


@pytest.mark.parametrize("thrust", [0.75, 0.81, 0.9])
def test_a_predicted_height_below_the_ground_is_no_evidence(thrust):
    # The model knows no ground: 0.12 s after the commit it believes to be far below.
    landing = land([0.12] * 2 + [-0.3] * 6, age=0.4, thrust=thrust)
    assert landing.phase is LandingPhase.COMMIT


def test_a_fresh_image_shows_that_the_feet_stand():
    landing = land([0.12] * 2 + [0.01] * 8)
    assert landing.phase is LandingPhase.DOWN
    assert landing.is_on_target


def test_an_image_of_an_aircraft_that_hangs_in_the_air_keeps_the_throttle_going_down():
    landing = Landing(LIMITS, estimate(0.0, 0.12))
    shares = [landing.goal(estimate(k * STEP, 0.12, climb=0.0, thrust=1.0), None, STEP).gas_share for k in range(40)]
    assert landing.phase is LandingPhase.COMMIT
    assert shares[0] == LIMITS.commit_gas
    assert shares[-1] == LIMITS.least_gas
    assert shares == sorted(shares, reverse=True)


def test_a_blind_fall_ends_when_it_cannot_have_been_longer():
    steps = 60
    landing = Landing(LIMITS, estimate(0.0, 0.12))
    down = None
    for k in range(steps):
        landing.goal(estimate(k * STEP, 0.12, age=0.4 if k else 0.1, thrust=0.7), None, STEP)
        down = k * STEP if down is None and landing.phase is LandingPhase.DOWN else down
    assert down is not None
    # From 0.15 m at 0.13 m/s with less than a fifth of its weight missing: about 0.4 s, and the settling.
    assert 0.3 < down < 0.8


def test_an_uncertain_height_is_no_place_to_commit():
    assert land([0.12] * 5, sd=0.08).phase is not LandingPhase.COMMIT


def test_who_comes_down_beside_the_target_has_not_landed_on_it():
    landing = Landing(LIMITS, estimate(0.0, 0.12))
    landing.goal(estimate(STEP, 0.12), None, STEP)
    for k in range(2, 12):
        landing.goal(estimate(k * STEP, 0.0, east=0.5), None, STEP)
    assert landing.phase is LandingPhase.DOWN
    assert not landing.is_on_target


def test_with_thrust_that_carries_no_fall_is_ever_over():
    fall = Fall(0.12, -0.28, 0.01)
    assert not any(fall.has_ended(1.0, STEP) for _ in range(500))


def test_the_cushion_is_bounded_where_the_rotors_are_as_low_as_they_get():
    fall = Fall(-0.2, -0.28, 0.0)
    before = fall.climb
    fall.has_ended(1.0 / (LARGEST_CUSHION * 1.08), STEP)
    assert fall.climb == pytest.approx(before)
