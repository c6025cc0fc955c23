"""What a check before a flight prevents: the lease, autonomous flight, or nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.control import preflight
from mkdaemon.control.activeset import ActiveSet, Gate, GateKind
from mkdaemon.control.estimator.model import AircraftModel, Gap, ModelUnknown
from mkdaemon.control.events import ActiveSetRead, ModelKnown, PoseSeen, StateValue
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame
from tests.control.events import CHANNEL, PERIOD, Driver, pose
from tests.control.test_checks import battery


@pytest.fixture
def drive():
    driver = Driver()
    driver.core.feed(PoseSeen(pose(0.0)), 0.0)
    return driver


def to_position(drive):
    drive.sequence += 1
    stream = {"epoch": drive.epoch, "sequence": drive.sequence, "ttl": 0.3}
    return drive.offer(PositionSetpoint(**stream, position=(0.0, 0.0, 2.0), frame=SetpointFrame.PAD))


def test_a_low_battery_prevents_autonomous_flight_until_it_is_charged_but_no_flight_by_sticks(drive):
    drive.core.feed(StateValue(battery(16.0, is_low=True)), drive.now)
    drive.take()
    assert to_position(drive).token == "battery_low"
    assert drive.put() is None
    drive.core.feed(StateValue(battery(16.0, is_low=False)), drive.now)
    assert to_position(drive).token == "battery_low"
    drive.now += 0.6
    assert to_position(drive) is None


def test_who_flies_flies_on_whatever_a_check_finds(drive):
    drive.take()
    for _ in range(80):
        drive.put()
        drive.run(PERIOD)
    assert drive.core.phase is Phase.FLYING
    drive.core.feed(StateValue(battery(16.0, is_low=True)), drive.now)
    assert to_position(drive) is None


def test_a_model_of_its_own_may_be_what_stands_in_the_way(drive):
    def loop():
        report = drive.core.preflight(drive.now)
        return next(found.token for found in report.findings if found.name == "control loop")

    assert loop() is None
    assert drive.core.gains() is drive.core.gains()
    drive.core.feed(ModelKnown(replace(AircraftModel(), rad_per_count=1e-4)), drive.now)
    assert loop() == "loop_unstable"
    assert drive.core.gains().degrees_per_count < 0.01
    drive.core.feed(ModelKnown(replace(AircraftModel(), a1=1e-200, a2=1e-200)), drive.now)
    with pytest.raises(CommandRejectedError, match="loop_unstable"):
        drive.core.gains()


def test_a_gain_on_a_potentiometer_prevents_autonomous_flight_but_no_flight_by_sticks(drive):
    drive.core.feed(ModelKnown(AircraftModel(), ModelUnknown(Gap.ON_POTENTIOMETER, "gyro_i", 255, 1)), drive.now)
    drive.take()
    error = to_position(drive)
    assert error.token == "gain_on_poti"
    assert "gyro_i = 255" in error.reason
    assert "gyro_i=..." in error.fix
    assert drive.put() is None
    drive.core.feed(ModelKnown(AircraftModel()), drive.now)
    drive.now += 0.6
    assert to_position(drive) is None


def read(drive, found):
    """What the checks find with an active set that was read just now."""
    drive.tell(ActiveSetRead(found))
    return drive.core.preflight(drive.now)


def test_the_report_has_what_was_read_last(drive):
    def height_control():
        report = drive.core.preflight(drive.now)
        return next(found.token for found in report.findings if found.name == "height control")

    assert read(drive, ActiveSet(CHANNEL, "Easy", has_height_control=True)).is_ready is False
    assert height_control() == "height_control"
    drive.take()
    assert height_control() is None


def test_a_gate_that_was_shut_is_read_again_before_the_next_lease(drive):
    read(drive, ActiveSet(Gate(GateKind.CONSTANT, 0), "Easy"))
    drive.take()


def test_in_flight_nothing_is_computed_that_would_hold_up_the_loop(drive, monkeypatch):
    drive.take()
    for _ in range(80):
        drive.put()
        drive.run(PERIOD)

    def compute(*_):
        raise AssertionError

    monkeypatch.setattr(preflight, "gains_of", compute)
    monkeypatch.setattr(preflight, "loop_refusal", compute)
    report = drive.core.preflight(drive.now)
    assert next(found.state for found in report.findings if found.name == "control loop") == "unknown"
    with pytest.raises(CommandRejectedError, match="busy"):
        drive.core.gains()
