"""What a check before a flight prevents: the lease, autonomous flight, or nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mkdaemon.config.control import ControlConfig, LimiterConfig
from mkdaemon.control import preflight
from mkdaemon.control.actions import PublishStatus
from mkdaemon.control.activeset import UNREAD, Gate, GateKind, KnownSet
from mkdaemon.control.estimator.model import AircraftModel, Gap, ModelUnknown
from mkdaemon.control.events import AbortAsked, ActiveSetRead, ModelKnown, PoseSeen, StateValue
from mkdaemon.control.motionmatch import Match, MotionMatch
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import AbortRequest
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame
from tests.control.admission.situations import SET, battery
from tests.control.events import CHANNEL, PERIOD, Driver, pose
from tests.control.flying import Flying


@pytest.fixture
def drive():
    driver = Driver()
    driver.core.feed(PoseSeen(pose(0.0)), 0.0)
    return driver


def to_position(drive):
    return drive.send(PositionSetpoint, position=(0.0, 0.0, 2.0), frame=SetpointFrame.PAD)


def test_who_flies_flies_on_whatever_a_check_finds_but_begins_nothing_else(drive):
    drive.take()
    drive.stream(1.6)
    assert drive.core.phase is Phase.FLYING
    drive.core.feed(StateValue(battery(16.0, is_low=True)), drive.now)
    assert to_position(drive).token == "battery_low"
    assert drive.put() is None
    drive.run(PERIOD)
    assert drive.core.phase is Phase.FLYING


def test_a_loop_that_is_not_safe_is_refused_in_flight_as_on_the_ground():
    drive = Driver(ControlConfig(limiter=LimiterConfig(slew=100.0)))
    drive.core.feed(PoseSeen(pose(0.0)), 0.0)
    drive.take()
    assert to_position(drive).token == "loop_unstable"
    drive.stream(2.0)
    assert drive.core.phase is Phase.FLYING
    assert to_position(drive).token == "loop_unstable"


def test_an_abort_of_a_flight_by_hand_begins_no_hold_that_a_check_forbids(drive):
    drive.take()
    drive.stream(1.6)
    drive.tell(PoseSeen(pose(drive.now)))
    drive.tell(StateValue(battery(16.0, is_low=True)))
    drive.tell(AbortAsked(AbortRequest()))
    drive.stream(0.3, pitch=20.0)
    assert drive.core.phase is Phase.ABORTED
    assert drive.of(PublishStatus)[-1].manoeuvre == "level"
    assert drive.sticks[-1].counts.pitch == 0


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


def read(drive, found):
    """What the checks find with an active set that was read just now."""
    drive.tell(ActiveSetRead(found))
    return drive.core.preflight(drive.now)


def test_the_report_has_what_was_read_last(drive):
    def height_control():
        report = drive.core.preflight(drive.now)
        return next(found.token for found in report.findings if found.name == "height control")

    assert read(drive, KnownSet(CHANNEL, "Easy", has_height_control=True)).is_ready is False
    assert height_control() == "height_control"
    drive.take()
    assert height_control() is None


def test_a_gate_that_was_shut_is_read_again_before_the_next_lease(drive):
    read(drive, KnownSet(Gate(GateKind.CONSTANT, 0), "Easy"))
    drive.take()


def test_in_flight_nothing_is_computed_that_would_hold_up_the_loop(drive, monkeypatch):
    drive.take()
    drive.stream(80 * PERIOD)

    def compute(*_):
        raise AssertionError

    monkeypatch.setattr(preflight, "gains_of", compute)
    monkeypatch.setattr(preflight, "loop_refusal", compute)
    known = drive.core.gains()
    drive.tell(ModelKnown(replace(AircraftModel(), rad_per_count=0.005)))
    report = drive.core.preflight(drive.now)
    assert next(found.token for found in report.findings if found.name == "control loop") is None
    assert drive.core.gains() is known, "it is flown by the model it began with"


AGILE = replace(AircraftModel(), rad_per_count=math.radians(0.601))


@pytest.mark.parametrize("is_in_flight", [False, True])
def test_a_read_that_fails_under_a_lease_changes_nothing(drive, is_in_flight):
    """The question that was not asked: what does a question that fails change?

    `mkctl preflight` under a lease forgot the set and the model: the next flight was flown by the wrong angle a count,
    and one that had begun meanwhile lost its estimate and was released.
    """
    drive.core.feed(ModelKnown(AGILE), drive.now)
    drive.take(gate=CHANNEL)
    drive.tell(ActiveSetRead(SET))
    if is_in_flight:
        for _ in range(80):
            drive.put()
            drive.core.feed(PoseSeen(pose(drive.now)), drive.now)
            drive.run(PERIOD)
        assert drive.core.phase is Phase.FLYING
    drive.tell(ModelKnown(AircraftModel(), ModelUnknown(Gap.UNREAD)))
    drive.tell(ActiveSetRead(UNREAD))
    assert drive.core._sight.model == AGILE
    assert drive.core.situation(drive.now).active_set == SET
    assert drive.core.situation(drive.now).model is None
    assert (drive.core._sight.estimator is not None) is is_in_flight


def test_before_a_lease_a_read_that_fails_leaves_nothing_known(drive):
    """Another aircraft, or another set, may be there now."""
    drive.core.feed(ModelKnown(AGILE), drive.now)
    drive.tell(ActiveSetRead(SET))
    drive.tell(ModelKnown(AircraftModel(), ModelUnknown(Gap.UNREAD)))
    drive.tell(ActiveSetRead(UNREAD))
    assert drive.core.situation(drive.now).active_set == UNREAD
    assert drive.core._sight.model == AircraftModel()


def test_stamps_are_compared_at_once_and_again_after_half_a_second(monkeypatch):
    monkeypatch.setattr(MotionMatch, "match", lambda motion, now, target: Match(now, 1.0))
    before = preflight.Preflight(ControlConfig(), VehicleMemory())
    flying = Flying()
    known = Phase.FREE, None, flying.flown, flying.sight
    assert before.situation(5.0, *known).stamps is None, "nothing was compared yet"
    lags = [before.compare(at).lag for at in (5.0, 5.4, 5.5, 5.9, 6.0)]
    assert before.situation(7.0, *known).stamps.lag == 6.0
    assert lags == [5.0, 5.0, 5.5, 5.5, 6.0]
