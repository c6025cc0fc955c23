"""Flight by stick and by attitude, and level flight: what they begin with, send, and become."""

from __future__ import annotations

import pytest

from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.attitude import AttitudeFlight
from mkdaemon.control.manoeuvres.hold import Hold
from mkdaemon.control.manoeuvres.level import Level
from mkdaemon.control.manoeuvres.stick import Stick
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, HoldSetpoint, StickSetpoint
from tests.control.manoeuvres.hovering import CFG, Hovering

BASE = {"epoch": 1, "sequence": 1, "ttl": 0.3}
BAND = 4.0


def sticks(pitch=0.0, roll=0.0, yaw=0.0, throttle=5.0):
    return StickSetpoint(**BASE, pitch=pitch, roll=roll, yaw=yaw, throttle=throttle)


def attitude(pitch=0.0, roll=0.0, yaw_rate=0.0, thrust=1.0):
    return AttitudeSetpoint(**BASE, pitch=pitch, roll=roll, yaw_rate=yaw_rate, thrust=thrust)


def by_stick(aircraft, **fields):
    return Stick(aircraft.sight, CFG, sticks(**fields), BAND)


def by_attitude(aircraft, **fields):
    return AttitudeFlight(aircraft.sight, CFG, attitude(**fields), CFG.neutral_band)


@pytest.mark.parametrize("make", [by_stick, by_attitude])
@pytest.mark.parametrize(("unseen", "after"), [(0.0, Hold), (1.49, Hold), (1.51, Level), (None, Level)])
def test_an_abort_holds_where_the_target_was_in_sight_lately_and_is_level_else(make, unseen, after):
    aircraft = Hovering()
    if unseen is not None:
        aircraft.look()
        aircraft.now += unseen
    assert type(make(aircraft).abort(aircraft.now)) is after


@pytest.mark.parametrize("axis", ["pitch", "roll", "yaw"])
@pytest.mark.parametrize(("size", "waits"), [(BAND, False), (-BAND, False), (BAND + 0.1, True), (-BAND - 0.1, True)])
def test_flight_begins_with_neutral_sticks_and_takes_over_with_any(axis, size, waits):
    aircraft = Hovering()
    manoeuvre = by_stick(aircraft, **{axis: size})
    assert bool(manoeuvre.enter(None, 1.0)) is waits
    assert manoeuvre.enter(Level(aircraft.sight), 1.0) == ""


@pytest.mark.parametrize(
    ("asked", "counts"),
    [("pitch", 4.0), ("pitch", -4.1), ("roll", 3.9), ("roll", 4.1)],
)
def test_flight_begins_with_a_level_attitude_and_takes_over_with_any(asked, counts):
    aircraft = Hovering()
    manoeuvre = by_attitude(aircraft, **{asked: counts * aircraft.sight.model.rad_per_count * 0.9999})
    assert bool(manoeuvre.enter(None, 1.0)) is (abs(counts) > 4.0)
    assert manoeuvre.enter(Level(aircraft.sight), 1.0) == ""
    assert by_attitude(aircraft, yaw_rate=1.0).enter(None, 1.0) == "waiting for a level attitude"


def test_sticks_are_those_of_the_newest_setpoint():
    aircraft = Hovering()
    manoeuvre = by_stick(aircraft)
    manoeuvre.follow(sticks(1.0, -2.0, 3.0, 4.0))
    step = manoeuvre.step(7.0, is_flying=True)
    assert (step.sticks, step.manoeuvre) == (Sticks(1.0, -2.0, 3.0, 4.0), "stick")
    assert manoeuvre.stepped_at == 7.0


@pytest.mark.parametrize("thrust", [0.0, 0.25, 1.0, 1.44])
def test_thrust_is_a_share_of_the_weight_by_the_newest_belief_of_what_carries(thrust):
    aircraft = Hovering()
    manoeuvre = by_attitude(aircraft, thrust=thrust)
    for hover in (aircraft.sight.hover_gas, 150.0):
        if hover == 150.0:
            aircraft.look()
            aircraft.sight.estimator.hover_gas = hover
        throttle = manoeuvre.step(aircraft.now, is_flying=True).sticks.throttle
        assert throttle == pytest.approx(hover * thrust**0.5 - GAS_CENTRE)


def test_level_flight_stays_level_at_the_throttle_that_carries():
    aircraft = Hovering()
    level = Level(aircraft.sight)
    assert level.enter(None, 1.0) == ""
    level.follow(HoldSetpoint(**BASE))
    assert level.step(3.0, is_flying=True).sticks == Sticks(0.0, 0.0, 0.0, -2.0)
    aircraft.look()
    aircraft.sight.estimator.hover_gas = 150.0
    assert level.step(3.0, is_flying=True).sticks == Sticks(0.0, 0.0, 0.0, 23.0)
    assert level.height_seen(1.0, 3.0) is None
    assert level.abort(3.0) is level
    assert not (level.is_by_target or level.keeps_place)
