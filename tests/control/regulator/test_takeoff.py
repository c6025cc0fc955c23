"""Take-off: throttle on the ground, what shows that it flies, and what ends it."""

from __future__ import annotations

import pytest

from mkdaemon.control.manoeuvres.manoeuvre import WORDS
from mkdaemon.control.manoeuvres.take_off import IDLE_GAS, OLDEST, TakeOff, TakeOffLimits, TakeOffPhase
from mkdaemon.telemetry.control import Outcome

LIMITS = TakeOffLimits(ready=1.0)
HOVER = 120.0
STEP = 0.02


def run(take_off, start, seconds, tilt=0.0):
    """Go on for a time; returns every throttle with its time."""
    steps = round(seconds / STEP)
    return [(start + k * STEP, take_off.gas(start + k * STEP, STEP, tilt)) for k in range(1, steps + 1)]


@pytest.fixture
def take_off():
    return TakeOff(LIMITS, HOVER, 0.0)


def test_two_images_of_a_climbing_aircraft_give_it_to_the_autopilot_with_the_heights_of_its_feet(take_off):
    run(take_off, 0.0, 1.6)
    assert take_off.seen(0.20, 1.50) == ()
    assert take_off.is_blind
    assert take_off.seen(0.22, 1.53) == ((1.50, pytest.approx(0.10)), (1.53, pytest.approx(0.12)))
    assert not take_off.is_blind
    assert take_off.seen(0.3, 1.6) == (), "it is known by now"


def test_one_image_of_a_climbing_aircraft_takes_the_throttle_back_to_hover_until_the_next(take_off):
    run(take_off, 0.0, 1.6)
    take_off.seen(0.20, 1.50)
    assert run(take_off, 1.6, STEP)[-1][1] == pytest.approx(HOVER)
    take_off.seen(0.11, 1.53)
    assert run(take_off, 1.62, STEP)[-1][1] > HOVER


def test_blind_time_counts_from_one_image_in_the_air_if_no_other_follows():
    take_off, _ = ramp(0.1)
    take_off.seen(0.20, LIMITS.ready + 0.05)
    run(take_off, LIMITS.ready + 0.1, LIMITS.blind + 0.1)
    assert take_off.failure is Outcome.NOT_LIFTED


def test_old_images_do_not_hand_a_flying_aircraft_to_the_autopilot(take_off):
    for k in range(1, round((LIMITS.ready + LIMITS.blind + 0.6) / STEP)):
        take_off.gas(k * STEP, STEP, 0.0)
        assert take_off.seen(0.2 + 0.01 * k, k * STEP - OLDEST - 0.01) == ()
    assert take_off.is_over
    assert take_off.failure is Outcome.NOT_LIFTED
    assert all(words in WORDS[take_off.failure] for words in ("too old", "gate", "hover_throttle"))


def test_in_the_air_only_the_climb_is_left_and_cannot_fail():
    take_off = TakeOff(LIMITS, HOVER, 0.0, is_in_air=True)
    assert not take_off.is_blind
    take_off.fail(Outcome.TAKE_OFF_ABORTED)
    assert take_off.phase is TakeOffPhase.CLIMB
    take_off.arrived()
    take_off.arrived()
    assert take_off.phase is TakeOffPhase.REACHED


def ramp(seconds):
    """A take-off whose throttle has risen for so long, and its throttles."""
    take_off = TakeOff(LIMITS, HOVER, 0.0)
    run(take_off, 0.0, LIMITS.ready)
    assert take_off.phase is TakeOffPhase.RAMP
    return take_off, [gas / HOVER for _, gas in run(take_off, LIMITS.ready, seconds)]


def test_throttle_rises_by_its_slope_from_idle_to_its_bound():
    _, shares = ramp(0.6)
    assert shares == pytest.approx(
        [min(IDLE_GAS / HOVER + LIMITS.rise * STEP * k, LIMITS.most) for k in range(1, len(shares) + 1)]
    )


def test_blind_time_counts_from_the_throttle_that_may_carry():
    until = LIMITS.rises_for(HOVER) + LIMITS.blind
    take_off, _ = ramp(until - STEP)
    assert take_off.phase is TakeOffPhase.RAMP
    run(take_off, LIMITS.ready + until - STEP, 3 * STEP)
    assert take_off.phase is TakeOffPhase.FAILED
    assert take_off.failure is Outcome.NOT_LIFTED


@pytest.mark.parametrize(("tilt", "fails"), [(0.255, False), (0.265, True)])
def test_a_foot_that_sticks_ends_it_at_fifteen_degrees(tilt, fails):
    take_off = TakeOff(LIMITS, HOVER, 0.0)
    run(take_off, 0.0, 0.5, tilt=0.5)
    assert take_off.phase is TakeOffPhase.IDLE, "before the throttle rises a tilt ends nothing"
    take_off, _ = ramp(0.1)
    run(take_off, LIMITS.ready + 0.1, STEP, tilt=tilt)
    assert take_off.failure is (Outcome.TIPPED if fails else None)


@pytest.mark.parametrize(
    ("images", "flies"),
    [
        ([(0.20, 1.50), (0.22, 1.53)], True),
        ([(0.165, 1.50), (0.165, 1.53)], True),
        ([(0.155, 1.50), (0.22, 1.53)], False),  # the first shows it no higher than 6 cm above where it stands
        ([(0.22, 1.50), (0.155, 1.53)], False),
        ([(0.22, 1.53), (0.22, 1.50)], False),  # in another order than taken
        ([(0.22, 1.50), (0.22, 1.50)], False),
        ([(0.22, 1.50)], False),
    ],
)
def test_two_images_in_a_row_must_show_it_above_the_ground(images, flies):
    take_off, _ = ramp(0.6)
    found = [take_off.seen(height, at) for height, at in images]
    assert (found[-1] != ()) is flies
    assert take_off.is_blind is not flies


def test_an_image_just_young_enough_counts():
    take_off, _ = ramp(1.0)
    assert take_off.seen(0.20, 2.0 - OLDEST + 0.01) == ()
    assert take_off.seen(0.22, 2.0 - OLDEST + 0.03) != ()
