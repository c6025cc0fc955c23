"""A battery that is low in flight: what counts, what is said, and how the flight ends."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lab.control.corerig import stamp
from mkdaemon.control.actions import Warn
from mkdaemon.control.activeset import UNREAD
from mkdaemon.control.events import StateValue
from mkdaemon.control.flightwatch import LASTING, BatteryWatch
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.telemetry.state import Battery
from tests.control.admission.situations import situation_of
from tests.control.events import PERIOD, Driver, flight

LOW_CELL = 3.2
SET = replace(UNREAD, name="Easy", low_cell=LOW_CELL)


def battery(voltage, *, is_low=False, at=0.0):
    return Battery(stamp=stamp(at), source="lab", voltage=voltage, current=None, used_mah=None, is_low=is_low)


def told(facts, found, now):
    """The situation of what was told, with an active set."""
    return replace(situation_of(facts, now), active_set=found)


def watched(*reports):
    """A watch that saw reports, each a voltage and when [V, s], of four cells."""
    facts = VehicleMemory()
    facts.state_received(battery(16.8), -1.0)
    watch = BatteryWatch()
    for voltage, at in reports:
        facts.state_received(battery(voltage), at)
        watch.look(told(facts, SET, at))
    return watch


@pytest.mark.parametrize(
    ("reports", "is_warned", "has_lasted"),
    [
        ([(12.8, 0.0)], False, False),
        ([(13.0, 0.0), (12.799, 1.0)], True, False),
        ([(12.7, 0.0), (12.7, 2.9)], True, False),
        ([(12.7, 0.0), (12.7, 3.0)], True, True),
        ([(12.7, 0.0), (13.05, 1.0), (12.7, 3.0)], True, True),  # not yet 2 % more: not yet the end of it
        ([(12.7, 0.0), (13.06, 2.0)], False, False),
        ([(12.7, 0.0), (13.2, 2.0), (12.7, 2.5), (12.7, 5.4)], True, False),  # it sags under load for a moment
    ],
)
def test_a_voltage_below_that_of_the_set_is_warned_of_at_once_and_counts_when_it_lasts(reports, is_warned, has_lasted):
    watch = watched(*reports)
    assert (watch.warning is not None, watch.has_lasted) == (is_warned, has_lasted)
    assert watch.warning is None or f"{reports[-1][0]:.1f} V" in watch.warning.reason


def test_the_boards_own_alarm_counts_where_the_set_is_not_known():
    facts = VehicleMemory()
    watch = BatteryWatch()
    watch.look(told(facts, UNREAD, 0.0))
    assert watch.warning is None, "it is not known how full the battery is"
    facts.state_received(battery(12.0), 0.0)
    facts.state_received(flight(is_flying=True).model_copy(update={"battery_low": True}), 0.0)
    watch.look(told(facts, UNREAD, 0.0))
    assert watch.warning is not None


def test_without_a_target_the_aircraft_is_released_with_an_alarm():
    drive = Driver()
    drive.fly()
    for _ in range(round((LASTING + 0.3) / PERIOD)):
        drive.core.feed(StateValue(battery(12.0, is_low=True)), drive.now)
        if not drive.releases:
            drive.stream(PERIOD)
    [release] = drive.releases
    assert release.reason == "the battery is low: 12.0 V. No target is in sight to land on: the pilot lands."
    [warning] = drive.of(Warn)
    assert warning.text == "the battery is low: 12.0 V. Land and change the battery."


def test_a_low_battery_of_an_earlier_flight_does_not_end_the_next_one():
    drive = Driver()
    for _ in range(2):
        drive.fly()
        for _ in range(round(0.5 * LASTING / PERIOD)):
            drive.core.feed(StateValue(battery(12.0, is_low=True)), drive.now)
            drive.stream(PERIOD)
        assert not drive.releases
        assert len(drive.of(Warn)) == 1, "told in every flight"
        drive.ask_release()
        drive.run(PERIOD)
        drive.release_ends()
        drive.run(2 * LASTING)


def at_rest(voltage, known=None):
    facts = VehicleMemory()
    if known is not None:
        facts.cells_known(known)
    facts.motors_reported(False, 1.0)
    facts.state_received(battery(voltage), 1.0)
    return facts


@pytest.mark.parametrize(
    ("voltage", "known", "cells", "is_doubtful"),
    [
        (12.8, None, 3, True),  # three full cells, or four that are nearly empty
        (12.8, 4, 4, False),
        (14.6, None, 4, False),  # five cells would rest at 2.92 V
        (16.8, None, 4, True),
        (16.8, 4, 4, False),
        (16.8, 3, 4, False),  # another battery than was remembered
    ],
)
def test_a_battery_that_may_have_one_more_cell_is_in_doubt(voltage, known, cells, is_doubtful):
    facts = at_rest(voltage, known)
    assert (facts.cells, facts.are_cells_doubtful) == (cells, is_doubtful)


def test_a_voltage_under_load_makes_no_count_certain():
    facts = VehicleMemory()
    facts.state_received(battery(16.4), 1.0)
    facts.motors_reported(True, 1.0)
    facts.state_received(battery(14.0), 1.5)
    assert (facts.certain_cells, facts.are_cells_doubtful) == (None, True)
    facts.motors_reported(False, 2.0)
    facts.state_received(battery(14.8), 2.1)
    assert (facts.certain_cells, facts.are_cells_doubtful) == (4, False)


def test_an_empty_battery_of_four_known_cells_is_low_at_the_voltage_of_four():
    facts = at_rest(12.7, known=4)
    watch = BatteryWatch()
    watch.look(told(facts, SET, 1.1))
    assert watch.warning is not None, "2.9 V a cell under load used to be flown without a word"
    unknown = BatteryWatch()
    unknown.look(told(at_rest(12.7), SET, 1.1))
    assert unknown.warning is None
