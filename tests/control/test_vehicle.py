"""What is known about the vehicle, and when it is too old to be known."""

from __future__ import annotations

import pytest

from mkdaemon.control.vehicle import MOTOR_TEST, REFUSALS_KEPT, VehicleMemory
from mkdaemon.telemetry.control import ControlLine, LeaseState, Obstacle
from mkdaemon.telemetry.link import LinkHealth
from mkdaemon.telemetry.state import Battery, Flight, Gps, GpsFix, Pilot, Position
from mkdaemon.telemetry.vision import PoseRefused, VisionStats
from tests.control.admission.situations import situation_of
from tests.control.events import STAMP, flight, link_state, pilot
from tests.values import made


def known(facts, at):
    """Whether motors run, whether it flies, and the pilot's throttle."""
    flown, received = facts.newest(Flight, at), facts.newest(Pilot, at)
    flies = None if flown is None else flown.is_flying
    return facts.motors_running(at), flies, None if received is None else received.throttle


@pytest.fixture
def facts():
    return VehicleMemory()


def test_at_first_and_by_values_that_decide_nothing_nothing_is_known(facts):
    facts.state_received(LeaseState(holder="a", epoch=1, ttl=1, left=1), 0.0)
    assert facts.link is None
    assert known(facts, 0.0) == (None, None, None)
    assert not facts.is_testing_motors(0.0)


def test_motors_hold_for_just_two_seconds_or_a_stricter_age(facts):
    facts.motors_reported(False, 10.0)
    assert [facts.motors_running(at, within=1.0) for at in (11.0, 11.1)] == [False, None]
    assert [facts.motors_running(at) for at in (11.1, 12.0, 12.01)] == [False, False, None]


def test_another_opening_of_the_port_voids_what_the_boards_said(facts):
    facts.link_changed(link_state(openings=1))
    facts.motors_reported(False, 10.0)
    facts.state_received(flight(is_flying=True), 10.0)
    facts.state_received(pilot(20.0), 10.0)
    facts.link_changed(link_state(openings=1))
    assert facts.motors_running(10.0) is False
    facts.link_changed(link_state(openings=2))
    assert known(facts, 10.0) == (None, None, None)


def test_a_motor_test_explains_turning_motors_for_a_while(facts):
    facts.motor_test_sent(5.0)
    assert facts.is_testing_motors(5.0 + MOTOR_TEST)
    assert not facts.is_testing_motors(5.01 + MOTOR_TEST)


def test_what_a_lost_flightctrl_said_is_unknown_at_once_and_nobody_may_fly():
    facts, line = VehicleMemory(), ControlLine(layout="v2")
    facts.motors_reported(False, 10.0)
    for value in EACH:
        facts.state_received(value, 10.0)
    assert facts.limit_line(line) is line
    facts.flightctrl_reported(is_lost=True)
    assert facts.is_fc_lost
    assert {facts.newest(type(value), 10.0) for value in EACH} | {facts.motors_running(10.0)} == {None}
    limited = facts.limit_line(line)
    assert (limited.layout, limited.obstacle) == (None, Obstacle.READ_ONLY)
    assert "FlightCtrl" in limited.reason
    facts.flightctrl_reported(is_lost=False)
    assert facts.limit_line(line) is line
    facts.flightctrl_reported(is_lost=True)
    facts.link_changed(link_state())
    facts.link_changed(link_state(openings=7))
    assert facts.limit_line(line) is line


PLACE = made(Position, STAMP, latitude_deg=53.0, longitude_deg=8.0, altitude_above_start=2.0)
RECEPTION = made(Gps, STAMP, satellites=9, fix=GpsFix.VALID, is_usable=True)
CHARGE = made(Battery, STAMP, voltage=16.0)


EACH = (flight(is_flying=True), PLACE, RECEPTION, pilot(20.0), CHARGE)


@pytest.mark.parametrize("value", EACH, ids=type)
def test_every_fact_holds_for_just_two_seconds(facts, value):
    facts.state_received(value, 10.0)
    assert [facts.newest(type(value), at) for at in (10.0, 12.0, 12.001)] == [value, value, None]


def flown_at(voltage, *, throttle=-20.0):
    """What the FlightCtrl says of its throttle, compensated at a voltage [V]."""
    return pilot(None).model_copy(update={"throttle_in_use": throttle, "compensated_at": voltage})


@pytest.mark.parametrize(
    ("voltage", "low_cell", "share"),
    [
        (14.8, None, 12.8 / 14.8),  # four cells of at most 4.3 V, each low at 3.2 V
        (14.8, 3.5, 14.0 / 14.8),
        (12.0, None, 9.6 / 12.0),  # three cells
        (12.95, None, 12.8 / 12.95),  # 4.3 V a cell would be four
        (12.85, None, 9.6 / 12.85),
        (12.0, 4.2, 1.0),  # below the warning nothing is taken back
        (5.0, None, 1.0),
        (4.9, None, None),  # no voltage of a battery that flies
        (60.0, None, 14 * 3.2 / 60.0),
        (60.1, None, None),
        (None, None, None),
    ],
)
def test_the_share_of_a_stick_that_is_reported_follows_from_voltage_and_cells(facts, voltage, low_cell, share):
    facts.state_received(flown_at(voltage), 10.0)
    found = facts.throttle_in_use(low_cell)
    assert (found.throttle, found.at) == (-20.0, 10.0)
    assert found.share == (None if share is None else pytest.approx(share))
    assert found.stick == pytest.approx(107.0 / (share or 1.0)), "in counts of 254"


def test_cells_are_counted_at_the_highest_voltage_of_this_battery(facts):
    for voltage in (16.4, 12.4):
        facts.state_received(CHARGE.model_copy(update={"voltage": voltage}), 10.0)
    facts.state_received(flown_at(12.4), 10.0)
    assert facts.highest_voltage == 16.4
    assert facts.throttle_in_use().share == 1.0, "four cells that are empty, not three"
    facts.link_changed(link_state(openings=1))
    assert facts.highest_voltage == 16.4
    facts.link_changed(link_state(openings=2))
    assert (facts.highest_voltage, facts.throttle_in_use()) == (0.0, None)


def test_who_does_not_tell_of_his_throttle_tells_nothing(facts):
    assert facts.throttle_in_use() is None
    facts.state_received(pilot(20.0), 10.0)
    assert facts.throttle_in_use() is None


@pytest.mark.parametrize(
    ("emergency", "has_signal", "is_lost"),
    [
        (True, True, True),  # the flight says it, whatever the receiver shows
        (False, False, False),
        (None, False, True),
        (None, True, False),
        (None, None, False),
    ],
)
def test_the_receiver_is_lost_by_what_the_flight_says_or_else_the_receiver(facts, emergency, has_signal, is_lost):
    assert not situation_of(facts, 10.0).is_receiver_lost
    facts.state_received(flight(is_flying=True).model_copy(update={"emergency_landing": emergency}), 10.0)
    if has_signal is not None:
        facts.state_received(pilot(0.0).model_copy(update={"has_signal": has_signal}), 10.0)
    assert situation_of(facts, 10.0).is_receiver_lost is is_lost
    assert not situation_of(facts, 12.1).is_receiver_lost


def test_what_else_is_told_is_kept(facts):
    assert (facts.health, facts.eyes, facts.list_changed_at, facts.free_disk) == (None, (), float("-inf"), None)
    down, forward = (VisionStats.model_construct(camera=name) for name in ("down", "forward"))
    for stats in (down, forward, down):
        facts.eye_reported(stats)
    facts.list_changed(7.0)
    facts.disk_measured(5e9)
    health = LinkHealth.model_construct()
    facts.link_measured(health)
    assert (facts.eyes, facts.list_changed_at, facts.free_disk) == ((down, forward), 7.0, 5e9)
    assert facts.health is health
    refused = [PoseRefused.model_construct(sequence=number) for number in range(REFUSALS_KEPT + 1)]
    assert facts.refused_sights == ()
    for one in refused:
        facts.sight_refused(one)
    assert facts.refused_sights == tuple(refused[1:])
