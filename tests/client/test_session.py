"""The flight session: every event in every state, and what must hold after any sequence of them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.client.session import (
    ENGAGING,
    GRACE,
    SETTLING,
    SIGHTING,
    SILENCE,
    FlightSession,
    RepeatedSetpoint,
    SessionState,
)
from mkdaemon.errors import CommandRejectedError, LeaseLostError, ManoeuvreError, MkError, NotEngagedError
from mkdaemon.telemetry.control import HolderGrant, Phase
from mkdaemon.telemetry.event import CommandEvent
from tests.client.sessionlease import STAMP, control_status

FREE, ASKED, HELD, LOST = SessionState
EPOCH = 7
STICKS = {"pitch": 1.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
HOLD = RepeatedSetpoint("hold", {}, SIGHTING)
FLIES, OTHER_FLIES = control_status(Phase.FLYING, EPOCH), control_status(Phase.FLYING, EPOCH + 1)
HELD_LEASE = CommandRejectedError("lease_held", "somebody flies.", "wait")
BUSY = CommandRejectedError("busy", "a release is under way.", "wait")


def grant(epoch=EPOCH):
    return HolderGrant(holder="me", epoch=epoch, ttl=5.0, left=5.0, secret="s")


def refusal(token="no_estimate", epoch=EPOCH):
    fields = {"key": "setpoint/hold", "fields": {"epoch": epoch}, "status": "denied", "reason": "no target.", "fix": ""}
    return CommandEvent.model_validate({"stamp": STAMP, "token": token} | fields)


def session(state, now=0.0, *, phase=None):
    """A session in a state; a held lease was granted now, and is reported where a phase is given."""
    made = FlightSession()
    if state is FREE:
        return made
    made.take()
    if state is ASKED:
        return made
    made.granted(grant(), now)
    if phase is not None or state is LOST:
        made.status_arrived(control_status(phase or Phase.LEASED, EPOCH), now)
    if state is LOST:
        made.status_arrived(control_status(Phase.FREE, None, reason="no setpoint for 1.0 s"), now)
    assert made.state is state
    return made


TABLE = {  # event, then the state that follows in FREE, ASKED, HELD and LOST; an exception that is raised instead
    "take": (lambda s: s.take(), ASKED, ASKED, HELD, LeaseLostError),
    "resume": (lambda s: s.resume(), FREE, ASKED, HELD, ASKED),
    "granted": (lambda s: s.granted(grant(), 0.0), FREE, HELD, HELD, LOST),
    "refused": (lambda s: s.refused(HELD_LEASE), FREE, LOST, HELD, LOST),
    "refused as busy": (lambda s: s.refused(BUSY), FREE, ASKED, HELD, LOST),
    "end": (lambda s: s.end(), FREE, FREE, FREE, FREE),
    "lost": (lambda s: s.lost("the network"), FREE, ASKED, LOST, LOST),
    "our status": (lambda s: s.status_arrived(FLIES, 0.0), FREE, ASKED, HELD, LOST),
    "status of another lease": (lambda s: s.status_arrived(OTHER_FLIES, SETTLING + 0.1), FREE, ASKED, LOST, LOST),
    "silence": (lambda s: s.step(SILENCE + 0.1), LeaseLostError, ASKED, LeaseLostError, LeaseLostError),
    "stream": (lambda s: s.stream("stick", STICKS, 0.0), LeaseLostError, ASKED, HELD, LeaseLostError),
    "fly": (lambda s: s.fly(HOLD, 0.0), LeaseLostError, ASKED, HELD, LeaseLostError),
    "step": (lambda s: s.step(0.0), LeaseLostError, ASKED, HELD, LeaseLostError),
    "renew": (lambda s: s.renew(0.0), LeaseLostError, LeaseLostError, HELD, LeaseLostError),
}
EVENTS = {name: event for name, (event, *_) in TABLE.items()}


@pytest.mark.parametrize(("before", "column"), list(zip(SessionState, range(1, 5), strict=True)))
@pytest.mark.parametrize("row", TABLE.values(), ids=TABLE)
def test_every_event_in_every_state(row, before, column):
    flight, after = session(before), row[column]
    if isinstance(after, SessionState):
        row[0](flight)
        assert flight.state is after
    else:
        with pytest.raises(after):
            row[0](flight)
        assert flight.state is (LOST if before is HELD else before)


def test_a_lost_or_refused_lease_is_reported_by_every_call_until_it_is_acknowledged():
    flight = session(LOST)
    for name in ("take", "stream", "fly", "step", "renew"):
        with pytest.raises(LeaseLostError, match=r"no setpoint for 1\.0 s"):
            EVENTS[name](flight)
    assert flight.reason == "no setpoint for 1.0 s"
    flight = session(ASKED)
    assert not flight.refused(HELD_LEASE)
    with pytest.raises(CommandRejectedError, match="somebody flies"):
        flight.stream("stick", STICKS, 0.0)
    flight.end()
    flight.take()
    assert flight.reason == "the lease is requested"


@pytest.mark.parametrize(("now", "state"), [(SETTLING, HELD), (SETTLING + 0.01, LOST)])
def test_a_status_from_before_the_lease_does_not_end_it(now, state):
    flight = session(HELD)
    flight.status_arrived(control_status(Phase.FREE, None), now)
    assert flight.state is state


def test_a_release_is_owed_once_and_not_where_the_daemon_has_ended_the_lease():
    wanted = {"action": "release", "epoch": EPOCH, "secret": "s"}
    assert session(FREE).release() is None
    assert session(LOST).release() is None
    held = session(HELD)
    held.end()
    assert (held.release(), held.release()) == (wanted, None)
    silent = session(HELD)
    with pytest.raises(LeaseLostError, match="has been silent"):
        silent.step(SILENCE + 0.1)
    assert silent.release() == wanted
    ended = session(ASKED)
    ended.end()
    ended.granted(grant(), 0.0)
    assert (ended.state, ended.release()) == (FREE, wanted), "granted when it was not wanted any more"


@pytest.mark.parametrize(
    "token", ["not_holder", "bad_field", "malformed", "wrong_epoch", "not_leased", "setpoint_late"]
)
def test_refusals_of_strangers_the_network_and_an_ended_lease_do_not_count(token):
    flight = session(HELD)
    flight.event_arrived(refusal(token), 0.0)
    flight.event_arrived(refusal(epoch=EPOCH - 1), 0.0)
    assert flight.take_refusal() is None
    flight.event_arrived(refusal(), 0.0)
    assert "no target" in flight.reason
    assert (str(flight.take_refusal()), flight.take_refusal()) == ("no_estimate: no target. ", None)


@pytest.mark.parametrize(
    ("now", "event", "error"),
    [
        (GRACE - 0.1, refusal(), None),
        (GRACE + 0.1, refusal(), CommandRejectedError),
        (SIGHTING, None, NotEngagedError),
        (SIGHTING - 0.1, None, None),
    ],
)
def test_a_flight_that_does_not_begin_is_an_error_after_its_grace_or_patience(now, event, error):
    flight = session(HELD)
    flight.fly(HOLD, 0.0)
    if event is not None:
        flight.event_arrived(event, now)
    flight.sign_of_life(now)
    if error is None:
        assert not flight.has_started(now)
        return
    with pytest.raises(error):
        flight.has_started(now)


def test_a_flight_has_begun_when_the_daemon_flies_its_kind_and_patience_counts_from_the_grant():
    flight = session(HELD, phase=Phase.FLYING)
    flight.fly(HOLD, 0.0)
    assert not flight.has_started(0.0)
    flight.status_arrived(control_status(Phase.FLYING, EPOCH, manoeuvre="hold"), 0.1)
    assert flight.has_started(0.1)
    flight.expect_stream(0.2, ENGAGING)
    assert flight.has_started(0.2)
    flight = session(ASKED)
    flight.fly(HOLD, 0.0)
    assert not flight.has_started(100.0)
    flight.granted(grant(), 100.0)
    flight.sign_of_life(111.9)
    assert not flight.has_started(111.9)


def test_a_setpoint_that_is_none_is_refused_before_anything_leaves():
    flight = session(HELD)
    with pytest.raises(CommandRejectedError, match="throttle"):
        flight.stream("stick", STICKS | {"throttle": math.nan}, 0.0)
    with pytest.raises(MkError, match="there is no setpoint 'stik'; there is stick"):
        flight.fly(RepeatedSetpoint("stik", {}, 1.0), 0.0)
    assert flight.sequence == 0 and flight.repeated is None


STEPS = st.lists(st.tuples(st.sampled_from(sorted(EVENTS)), st.floats(0.0, 1.5)), max_size=40)


@given(STEPS)
def test_nothing_leaves_without_a_lease_no_stream_is_repeated_and_numbers_count_up(steps):
    flight, now, epoch, asked = FlightSession(), 0.0, 0, False
    sent: list[tuple[int, int]] = []
    streaming = False
    for name, passed in steps:
        now += passed
        before, setpoint = flight.state, None
        try:
            match name:
                case "granted":
                    epoch += asked  # a daemon grants what it was asked for, each lease with an epoch of its own
                    if asked:
                        flight.granted(grant(epoch), now)
                case "our status":
                    flight.status_arrived(control_status(Phase.FLYING, epoch), now)
                case "status of another lease":
                    flight.status_arrived(control_status(Phase.FREE, None), now)
                case "silence" | "step":
                    setpoint = flight.step(now)
                    assert setpoint is None or not streaming, "a stream was repeated"
                case "stream":
                    setpoint = flight.stream("stick", STICKS, now)
                    streaming = True
                case "fly":
                    flight.fly(HOLD, now)
                    streaming = False
                case _:
                    EVENTS[name](flight)
        except MkError:
            assert setpoint is None
        asked = flight.state is ASKED
        if setpoint is not None:
            assert before is HELD and setpoint.epoch == epoch
            sent.append((setpoint.epoch, setpoint.sequence))
        if before is LOST and flight.state is not LOST:
            assert name in {"resume", "end"}, "a lost lease was asked for again without a decision"
        if flight.state is LOST:
            assert flight.reason and flight.repeated is None
    assert sent == sorted(set(sent))


def test_a_manoeuvre_that_is_not_done_in_time_says_where_it_stands():
    flight = session(HELD, phase=Phase.FLYING)
    flight.fly(RepeatedSetpoint("position", {"position": (0, 0, 2), "frame": "pad"}, 1.0, 1.0, is_until_done=True), 0.0)
    flight.step(0.0)
    flight.status_arrived(control_status(Phase.FLYING, EPOCH, stage="on the way"), 0.9)
    with pytest.raises(ManoeuvreError, match="position not done within 1 s: on the way"):
        flight.step(1.0)
