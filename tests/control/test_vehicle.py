"""What is known about the vehicle, and when it is too old to be known."""

from __future__ import annotations

import pytest

from mkdaemon.control.vehicle import FRESH, MOTOR_TEST, VehicleMemory
from mkdaemon.telemetry.control import ControlLine, LeaseState, Obstacle
from mkdaemon.telemetry.state import Battery, Gps, GpsFix, Position
from tests.control.events import STAMP, flight, link_state, pilot


def test_at_first_nothing_is_known():
    facts = VehicleMemory()
    assert facts.link is None
    assert facts.motors_running(0.0) is None
    assert facts.is_flying(0.0) is None
    assert facts.pilot_throttle(0.0) is None
    assert not facts.is_testing_motors(0.0)


def test_facts_hold_until_they_are_too_old():
    facts = VehicleMemory()
    facts.motors_reported(True, 10.0)
    facts.state_received(flight(is_flying=True), 10.0)
    facts.state_received(pilot(20.0), 10.0)
    facts.link_changed(link_state())
    last = 10.0 + FRESH
    assert (facts.motors_running(last), facts.is_flying(last), facts.pilot_throttle(last)) == (True, True, 20.0)
    late = last + 0.01
    assert (facts.motors_running(late), facts.is_flying(late), facts.pilot_throttle(late)) == (None, None, None)
    assert facts.link == link_state()


def test_motors_may_be_asked_for_with_a_stricter_age():
    facts = VehicleMemory()
    facts.motors_reported(False, 10.0)
    assert facts.motors_running(11.0, within=1.0) is False
    assert facts.motors_running(11.1, within=1.0) is None
    assert facts.motors_running(11.1) is False


def test_another_opening_of_the_port_voids_what_the_boards_said():
    facts = VehicleMemory()
    facts.link_changed(link_state(openings=1))
    facts.motors_reported(False, 10.0)
    facts.state_received(flight(is_flying=True), 10.0)
    facts.state_received(pilot(20.0), 10.0)
    facts.link_changed(link_state(openings=1))
    assert facts.motors_running(10.0) is False
    facts.link_changed(link_state(openings=2))
    assert (facts.motors_running(10.0), facts.is_flying(10.0), facts.pilot_throttle(10.0)) == (None, None, None)


def test_a_motor_test_explains_turning_motors_for_a_while():
    facts = VehicleMemory()
    facts.motor_test_sent(5.0)
    assert facts.is_testing_motors(5.0 + MOTOR_TEST)
    assert not facts.is_testing_motors(5.01 + MOTOR_TEST)


def test_values_that_decide_nothing_are_ignored():
    facts = VehicleMemory()
    facts.state_received(LeaseState(holder="a", epoch=1, ttl=1, left=1), 0.0)
    assert facts.flight(0.0) is None


def test_what_a_lost_flightctrl_said_is_unknown_at_once_and_nobody_may_fly():
    facts, line = VehicleMemory(), ControlLine(layout="v2")
    facts.motors_reported(False, 10.0)
    facts.state_received(flight(is_flying=False), 10.0)
    assert facts.limit_line(line) is line
    facts.flightctrl_reported(is_lost=True)
    assert (facts.motors_running(10.0), facts.is_flying(10.0)) == (None, None)
    limited = facts.limit_line(line)
    assert (limited.layout, limited.obstacle) == (None, Obstacle.READ_ONLY)
    assert "FlightCtrl" in limited.reason
    facts.flightctrl_reported(is_lost=False)
    assert facts.limit_line(line) is line
    facts.flightctrl_reported(is_lost=True)
    facts.link_changed(link_state())
    facts.link_changed(link_state(openings=7))
    assert facts.limit_line(line) is line


STAMPED = {"stamp": STAMP, "source": "nc/osd"}
PLACE = Position(
    **STAMPED, latitude_deg=53.0, longitude_deg=8.0, altitude=None, altitude_above_start=2.0, position_enu=None,
    home_latitude_deg=53.0, home_longitude_deg=8.0, home_distance=0.0,
)  # fmt: skip
RECEPTION = Gps(**STAMPED, satellites=9, fix=GpsFix.VALID, is_usable=True, is_home_set=True)
CHARGE = Battery(**STAMPED, voltage=16.0, current=None, used_mah=None, is_low=None)


@pytest.mark.parametrize(
    ("told", "ask"),
    [
        (flight(is_flying=True), VehicleMemory.flight),
        (PLACE, VehicleMemory.position),
        (RECEPTION, VehicleMemory.gps),
        (pilot(20.0), VehicleMemory.pilot),
        (CHARGE, VehicleMemory.battery),
    ],
)
def test_every_fact_holds_for_just_two_seconds(told, ask):
    facts = VehicleMemory()
    facts.state_received(told, 10.0)
    assert [ask(facts, at) for at in (10.0, 12.0, 12.001)] == [told, told, None]
