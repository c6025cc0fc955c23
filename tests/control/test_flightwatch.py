"""What ends a flight without anybody asking: the line, the receiver, what the boards do with the sticks besides."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mkdaemon.control.events import LinkVerdict, PoseSeen, StateValue
from mkdaemon.control.flightwatch import FlightWatch, LinePatience
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.goto import Goto
from mkdaemon.control.manoeuvres.manoeuvre import Step
from mkdaemon.control.manoeuvres.table import MANOEUVRES
from mkdaemon.control.modes import Trigger
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame, StickSetpoint
from mkdaemon.telemetry.state import GpsMode
from tests.control.admission.situations import GOOD
from tests.control.events import PERIOD, Driver, flight, link_state, pilot, pose


class Anywhere(Goto):
    """A manoeuvre that is always content."""

    def enter(self, before, now):
        return ""

    def step(self, now, *, is_flying):
        return Step(Sticks(0.0, 0.0, 0.0, -2.0), self.kind)


ANYWHERE = {PositionSetpoint: lambda sight, cfg, new: Anywhere(sight, cfg.autopilot, new)}


PLACE = {"position": (0.0, 0.0, 2.0), "frame": SetpointFrame.PAD}


def by_position(drive, seconds, *, frame=SetpointFrame.PAD, refused=None):
    """Positions against the target that is in sight, fifty a second."""
    for _ in range(round(seconds / PERIOD)):
        drive.core.feed(PoseSeen(pose(drive.now)), drive.now)
        refusal = drive.send(PositionSetpoint, **PLACE | {"frame": frame})
        assert (None if refusal is None else refusal.token) == refused
        drive.run(PERIOD)


@pytest.mark.parametrize("mode", [mode for mode in GpsMode if mode.steers])
def test_a_navictrl_that_steers_too_ends_a_flight_by_position(mode):
    drive = Driver(rows=ANYWHERE)
    drive.core.feed(PoseSeen(pose(drive.now)), drive.now)
    drive.take()
    by_position(drive, 3.0)
    assert drive.core.phase is Phase.FLYING
    for other in (each for each in GpsMode if not each.steers):
        drive.core.feed(StateValue(flight(is_flying=True).model_copy(update={"gps_mode": other})), drive.now)
        by_position(drive, 0.1)
        assert drive.core.phase is Phase.FLYING
    drive.core.feed(StateValue(flight(is_flying=True).model_copy(update={"gps_mode": mode})), drive.now)
    drive.run(0.1)
    [release] = drive.releases
    assert release.reason.endswith(f"the pilot's GPS switch is at {mode.value}, so the NaviCtrl steers too")


@pytest.mark.parametrize(
    ("is_flying", "is_on", "ends"), [(True, True, True), (True, False, False), (False, True, False)]
)
def test_height_control_that_is_switched_on_ends_every_flight_and_on_the_ground_no_lease(is_flying, is_on, ends):
    drive = Driver()
    drive.fly() if is_flying else drive.take()
    drive.core.feed(StateValue(flight(is_flying=is_flying).model_copy(update={"altitude_control": is_on})), drive.now)
    drive.stream(0.1)
    reasons = [release.reason for release in drive.releases]
    assert [("height control is on, so the throttle is a climb rate" in reason) for reason in reasons] == [True] * ends
    assert ends or drive.core.phase is (Phase.FLYING if is_flying else Phase.LEASED)


@pytest.mark.parametrize("mode", [GpsMode.HOLD, GpsMode.COME_HOME])
def test_a_flight_by_hand_goes_on_while_the_navictrl_steers(mode):
    drive = Driver()
    drive.fly()
    drive.core.feed(StateValue(flight(is_flying=True).model_copy(update={"gps_mode": mode})), drive.now)
    drive.stream(0.3)
    assert drive.core.phase is Phase.FLYING


@pytest.mark.parametrize("told_by", ["flight", "pilot"])
@pytest.mark.parametrize("is_flying", [True, False])
def test_a_receiver_that_is_lost_ends_a_flight_and_on_the_ground_nothing(is_flying, told_by):
    drive = Driver()
    drive.fly() if is_flying else drive.take()
    lost = flight(is_flying=is_flying).model_copy(update={"emergency_landing": True})
    if told_by == "pilot":
        lost = pilot(0.0).model_copy(update={"has_signal": False})
    drive.core.feed(StateValue(lost), drive.now)
    drive.run(0.1)
    assert ["the receiver is lost" in release.reason for release in drive.releases] == [True] * is_flying


@pytest.mark.parametrize(
    ("condition", "seconds", "is_over"),
    [
        (LinkCondition.UP, 100.0, False),
        (LinkCondition.DOWN, 0.0, True),
        (LinkCondition.ABSENT, 0.0, True),
        (LinkCondition.CLOSED, 0.0, True),
        (LinkCondition.MUTE, 0.64, False),
        (LinkCondition.MUTE, 0.66, True),
        (LinkCondition.GARBAGE, 0.64, False),
        (LinkCondition.GARBAGE, 0.66, True),
        (LinkCondition.ONE_WAY, 0.99, False),
        (LinkCondition.ONE_WAY, 1.01, True),
    ],
)
def test_patience_with_each_kind_of_line(condition, seconds, is_over):
    patience = LinePatience(one_way=1.0)
    patience.lease_taken(1)
    link = link_state(condition)
    patience.watch(link, 10.0)
    assert patience.is_over(link, 10.0 + seconds) is is_over


@pytest.mark.parametrize(
    ("condition", "seconds", "is_kept"),
    [
        (LinkCondition.ONE_WAY, 1.9, True),
        (LinkCondition.MUTE, 1.9, True),
        (LinkCondition.MUTE, 2.2, False),
        (LinkCondition.CLOSED, 0.1, False),
    ],
)
def test_a_lease_that_sends_nothing_outlives_lost_link_tests_and_no_restart_of_the_board(condition, seconds, is_kept):
    drive = Driver()
    drive.take()
    drive.core.feed(LinkVerdict(link_state(condition)), drive.now)
    drive.run(seconds)
    assert (drive.core.phase is Phase.LEASED) is is_kept


def test_patience_begins_when_the_line_grows_bad_and_anew_after_it_was_good():
    patience = LinePatience(one_way=0.5)
    patience.lease_taken(1)
    bad, good = link_state(LinkCondition.ONE_WAY), link_state()
    patience.watch(bad, 10.0)
    patience.watch(bad, 10.4)
    assert patience.is_over(bad, 10.51)
    patience.watch(good, 10.45)
    assert not patience.is_over(good, 20.0)
    patience.watch(bad, 20.0)
    assert not patience.is_over(bad, 20.4)


def test_a_line_that_does_not_hear_us_and_then_falls_silent_has_the_patience_of_each():
    patience = LinePatience(one_way=1.0)
    patience.lease_taken(1)
    deaf, mute = link_state(LinkCondition.ONE_WAY), link_state(LinkCondition.MUTE)
    patience.watch(deaf, 10.0)
    patience.watch(mute, 10.25)
    assert not patience.is_over(mute, 10.85)
    assert patience.is_over(mute, 10.91)
    patience.watch(deaf, 10.6)
    assert not patience.is_over(deaf, 10.95)
    assert patience.is_over(deaf, 11.01)


@pytest.mark.parametrize(
    ("taken", "link", "is_over"),
    [(None, 0, False), (3, 4, True), (3, 3, False)],
)
def test_another_opening_of_the_port_is_the_end_whatever_the_line_is_like(taken, link, is_over):
    patience = LinePatience(one_way=0.5)
    if taken is not None:
        patience.lease_taken(taken)
    assert patience.is_over(link_state(openings=link), 0.0) is is_over


@pytest.mark.parametrize(("link", "ends"), [(None, False), (link_state(openings=7), True)])
def test_a_lease_ends_with_another_opening_of_the_port_and_not_while_no_line_was_judged(link, ends):
    held = replace(GOOD, holder="alice", phase=Phase.LEASED, link=link)
    found = FlightWatch(one_way=0.5).look(held, None)
    assert (None if found is None else found.trigger) is (Trigger.LINK_LOST if ends else None)


def refused_stream(drive, seconds):
    """Positions in a frame nobody can fly to."""
    by_position(drive, seconds, frame=SetpointFrame.HOME, refused="no_frame")


def test_a_place_is_kept_while_its_holder_streams_what_is_refused():
    drive = Driver(rows=ANYWHERE)
    drive.core.feed(PoseSeen(pose(drive.now)), drive.now)
    drive.take()
    by_position(drive, 3.0)
    refused_stream(drive, 1.2)
    assert drive.core.phase is Phase.FLYING
    drive.run(0.4)
    assert drive.core.phase is Phase.STALE, "silence is silence"


def test_sticks_grow_stale_while_their_holder_streams_what_is_refused():
    drive = Driver(rows=ANYWHERE | {StickSetpoint: MANOEUVRES[StickSetpoint]})
    drive.fly()
    refused_stream(drive, 0.4)
    assert drive.core.phase is Phase.STALE
