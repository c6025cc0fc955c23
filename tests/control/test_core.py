"""The flight core as a list of events: what is sent, when, and why nothing is."""

from __future__ import annotations

import pytest

from mkdaemon.control.actions import PublishStatus, ReportCommand, ReportFailsafe, ReportMode, SendSticks, Warn
from mkdaemon.control.events import (
    ClientGone,
    FrameConfirmed,
    FrameSent,
    GuardActed,
    GuardChanged,
    LeaseAsked,
    LineChanged,
    LinkVerdict,
    Reply,
    SetpointUnreadable,
    SetpointUnsigned,
)
from mkdaemon.control.flightwatch import SILENCE
from mkdaemon.control.output import SHORTEST_STEP
from mkdaemon.control.pacing import IDLE_PERIOD, JUST_AFTER
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import LeaseRequest
from mkdaemon.telemetry.control import ControlLine, Obstacle, Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import StickSetpoint
from tests.control.events import CFG, PERIOD, Driver, link_state

LEVEL = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}


@pytest.fixture
def drive():
    return Driver()


def token_of(call):
    with pytest.raises(CommandRejectedError) as caught:
        call()
    return caught.value.token


def test_a_live_neutral_stream_is_sent_after_a_second_and_each_setpoint_once(drive):
    drive.take()
    drive.stream(CFG.lease.engage_after - PERIOD)
    assert drive.sticks == []
    drive.stream(1.0)
    assert drive.core.phase is Phase.FLYING
    sequences = [sent.sequence for sent in drive.sticks]
    assert sequences == sorted(set(sequences))
    assert {sent.epoch for sent in drive.sticks} == {drive.epoch}
    assert {sent.age for sent in drive.sticks} == {0.0}


def test_a_setpoint_that_does_not_come_is_repeated_after_one_and_a_half_periods(drive):
    drive.fly()
    drive.put(pitch=20.0)
    drive.run(1.5 / CFG.rate + 0.001)
    first, second = drive.sticks
    assert first.sequence == second.sequence
    assert second.age == pytest.approx(1.5 / CFG.rate)


def test_silence_gives_neutral_sticks_at_its_deadline_then_a_release(drive):
    drive.fly()
    drive.put(pitch=40.0)
    began = drive.now
    drive.run(2.0)
    neutral = next(
        at for at, sent in drive.done if isinstance(sent, SendSticks) and sent.age > CFG.limiter.setpoint_ttl
    )
    assert neutral - began == pytest.approx(CFG.limiter.setpoint_ttl + JUST_AFTER)
    assert all(sent.counts.pitch == 0 for sent in drive.sticks if sent.age > CFG.limiter.setpoint_ttl)
    [released] = [at for at, action in drive.done if action in drive.releases]
    assert released - began == pytest.approx(CFG.lease.release_after + JUST_AFTER)
    assert [event.action for event in drive.of(ReportFailsafe)] == ["neutral"]
    drive.release_ends()
    drive.tick()
    assert [(event.action, event.released) for event in drive.of(ReportFailsafe)][1:] == [("release", True)]


def test_the_first_setpoint_of_an_epoch_is_reported_and_refusals_once_a_second(drive):
    drive.take()
    drive.put()
    drive.put()
    drive.tick()
    [first] = drive.of(ReportCommand)
    assert (first.key, first.result.status, first.fields["epoch"]) == ("setpoint/stick", "accepted", drive.epoch)
    drive.done.clear()
    drive.tell(SetpointUnsigned(StickSetpoint(epoch=drive.epoch, sequence=1, ttl=0.3, **LEVEL)))
    drive.tick()
    assert [event.result.token for event in drive.of(ReportCommand)] == ["not_holder"], "counted apart"
    drive.done.clear()
    for _ in range(15):
        error = drive.put(epoch=7)
        assert error is not None
        assert error.token == "wrong_epoch"
        drive.run(0.1)
    assert [event.result.token for event in drive.of(ReportCommand)] == ["wrong_epoch"] * 2
    assert drive.of(PublishStatus)[-1].refused > 10


def test_a_refused_setpoint_does_not_bring_the_next_tick_forward(drive):
    drive.run(0.05)
    before = drive.core.next_time()
    drive.put(epoch=7)
    drive.tell(
        SetpointUnreadable("setpoint/stick", {"bytes": 3}, refuse(Token.MALFORMED, detail="x"), is_by_holder=False)
    )
    assert drive.core.next_time() == before
    drive.run(1.1)
    assert drive.of(PublishStatus)[-1].refused == 2  # what nobody could read is counted too


def test_the_gate_is_read_before_a_lease_but_not_before_a_take_over(drive):
    assert drive.tell(LeaseAsked(LeaseRequest(action="take", holder="alice"), "s")) == Reply(must_read_set=True)
    drive.take("alice")
    reply = drive.tell(LeaseAsked(LeaseRequest(action="take", holder="bob", force=True), "t"))
    assert reply.lease.holder == "bob"


def test_renew_show_and_give_back(drive):
    epoch = drive.take()
    assert drive.request("show").epoch == epoch
    assert drive.request("renew", epoch=epoch).epoch == epoch
    assert token_of(lambda: drive.request("renew")) == "wrong_epoch"
    assert drive.request("release", epoch=epoch) is None
    assert drive.request("show") is None
    assert token_of(lambda: drive.request("release")) == "not_leased"


def test_the_lease_is_one_clients_at_a_time_unless_it_is_taken_by_force(drive):
    drive.take("alice")
    drive.run(1.0)
    with pytest.raises(CommandRejectedError, match=r"lease_held.*alice.*4\.0 s"):
        drive.request(holder="bob")
    assert token_of(lambda: drive.request(holder="alice")) == "lease_held", "another client of that name"
    assert drive.request("show").holder == "alice"
    assert drive.request(holder="bob", force=True).holder == "bob"


def test_nobody_takes_the_lease_while_a_release_is_under_way(drive):
    drive.take()
    drive.request("release", epoch=drive.epoch)
    drive.tick()
    assert token_of(lambda: drive.request(holder="bob")) == "busy"
    drive.release_ends()
    assert drive.request(holder="bob").holder == "bob"


def test_a_client_that_is_gone_is_released_and_a_stranger_means_nothing(drive):
    drive.core.feed(ClientGone("alice"), drive.now)
    drive.fly()
    drive.core.feed(ClientGone("bob"), drive.now)
    drive.tick()
    assert drive.releases == []
    drive.core.feed(ClientGone("alice"), drive.now)
    drive.now += SHORTEST_STEP
    drive.tick()
    assert [release.reason for release in drive.releases] == ["client alice is gone"]
    drive.release_ends()
    drive.tick()
    assert [(event.action, event.released) for event in drive.of(ReportFailsafe)] == [("release", True)]


def test_an_asked_release_is_no_failsafe_and_nothing_is_sent_while_it_runs(drive):
    epoch = drive.fly()
    drive.ask_release("big red button")
    drive.run(SHORTEST_STEP)
    assert [release.reason for release in drive.releases] == ["big red button"]
    drive.done.clear()
    drive.stream(1.0, epoch=epoch)
    drive.ask_release("again")
    drive.run(1.0)
    assert drive.sticks == []
    assert drive.releases == [], "one at a time"
    assert drive.of(PublishStatus)[0].phase is Phase.RELEASING
    drive.release_ends()
    drive.tick()
    assert [release.reason for release in drive.releases] == ["again"]
    drive.release_ends()
    drive.tick()
    assert drive.of(ReportFailsafe) == []
    assert drive.core.phase is Phase.FREE


def test_a_release_under_way_is_looked_at_regularly_so_that_the_watchdog_sees_progress(drive):
    drive.ask_release()
    drive.tick()
    assert drive.core.next_time() == pytest.approx(drive.now + IDLE_PERIOD)


@pytest.mark.parametrize(
    ("condition", "patience"),
    [(LinkCondition.DOWN, 0.0), (LinkCondition.MUTE, SILENCE), (LinkCondition.ONE_WAY, CFG.lease.release_after)],
)
def test_a_bad_line_ends_the_lease_after_its_patience(drive, condition, patience):
    drive.fly()
    drive.core.feed(LinkVerdict(link_state(condition, "gone")), drive.now)
    began = drive.now
    drive.stream(patience + 0.1)
    [(at, release)] = [(at, action) for at, action in drive.done if action in drive.releases]
    assert release.reason == f"the link is {condition.value}: gone"
    assert patience <= at - began <= patience + 2 * PERIOD


def reasons_without_a_lease(drive):
    """What clients are told from when nobody holds the lease any more."""
    return [each.reason for each in drive.of(PublishStatus) if each.lease is None]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (ControlLine(None, Obstacle.READ_ONLY, "gone"), "external control is not possible: gone"),
        (ControlLine("v2", Obstacle.RELEASING), refuse(Token.RELEASING).reason),
        (ControlLine("v2", Obstacle.UNCONFIRMED), refuse(Token.UNCONFIRMED).reason),
    ],
)
def test_what_ends_with_the_line_is_released_at_once_and_its_holder_is_told_why(drive, line, reason):
    drive.fly()
    drive.core.feed(LineChanged(line), drive.now)
    drive.now += 0.03
    drive.tick()
    assert drive.core.next_time() <= drive.now
    drive.stream(0.1)
    assert [release.reason for release in drive.releases] == [reason]
    assert set(reasons_without_a_lease(drive)) == {reason}
    assert drive.sticks == []


def test_whoever_loses_the_lease_during_a_release_is_told_why_and_not_why_the_one_before_lost_it(drive):
    drive.fly("alice")
    drive.request(holder="bob", force=True)
    drive.tick()
    assert drive.of(PublishStatus)[-1].reason == "bob took the lease from alice"
    drive.core.feed(ClientGone("bob"), drive.now)
    drive.tick()
    drive.release_ends()
    drive.tick()
    assert set(reasons_without_a_lease(drive)) == {"client bob is gone"}


def test_frames_the_line_does_not_take_are_reported_once_a_second_and_keep_the_lease(drive):
    drive.fly()
    drive.core.feed(LineChanged(ControlLine("v2", Obstacle.LINK_DOWN, "unplugged")), drive.now)
    drive.stream(1.5)
    assert drive.sticks == []
    assert drive.releases == []
    assert len(drive.of(Warn)) == 2
    assert "stick frame not sent: link_down" in drive.of(Warn)[0].text
    drive.core.feed(LineChanged(ControlLine("v2")), drive.now)
    drive.stream(0.1)
    assert drive.sticks


def test_after_the_line_took_no_frames_tilt_begins_from_neutral_again(drive):
    drive.fly()
    drive.stream(0.5, pitch=60.0)
    assert drive.sticks[-1].counts.pitch == 60
    drive.core.feed(LineChanged(ControlLine("v2", Obstacle.LINK_DOWN, "unplugged")), drive.now)
    drive.stream(0.4, pitch=60.0)
    before = len(drive.sticks)
    drive.core.feed(LineChanged(ControlLine("v2")), drive.now)
    drive.stream(0.02, pitch=60.0)
    assert drive.sticks[before].counts.pitch < 30
    drive.stream(0.5, pitch=60.0)
    assert drive.sticks[-1].counts.pitch == 60


def test_every_change_of_phase_is_reported_with_its_reason(drive):
    epoch = drive.take()
    drive.stream(1.2)
    drive.request("release", epoch=epoch)
    drive.run(0.1)
    drive.release_ends()
    drive.run(0.1)
    steps = [(event.before.value, event.after.value) for event in drive.of(ReportMode)]
    assert steps == [("free", "leased"), ("leased", "flying"), ("flying", "releasing"), ("releasing", "free")]
    assert drive.of(ReportMode)[2].reason == "alice gave the lease back"


def test_status_counts_what_becomes_of_stick_frames(drive):
    drive.fly()
    drive.core.feed(FrameSent(7), drive.now)
    drive.core.feed(FrameSent(8), drive.now)
    drive.core.feed(FrameConfirmed(7), drive.now)
    drive.core.feed(FrameConfirmed(7), drive.now)
    drive.core.feed(FrameConfirmed(99), drive.now)
    drive.run(2.5)
    status = drive.of(PublishStatus)[-1]
    assert status.frames_handed_over >= len(drive.sticks) > 0
    assert (status.frames_sent, status.frames_confirmed) == (2, 1)


def test_without_a_guard_nobody_gets_a_lease_and_a_flight_goes_on(drive):
    drive.core.feed(GuardChanged(is_alive=False), drive.now)
    assert token_of(drive.take) == "guard_dead"
    drive.core.feed(GuardChanged(is_alive=True), drive.now)
    drive.fly()
    drive.core.feed(GuardChanged(is_alive=False), drive.now)
    drive.stream(1.0)
    assert drive.core.phase is Phase.FLYING


def test_a_release_by_the_guard_ends_the_lease_and_is_followed_by_our_own(drive):
    drive.fly()
    drive.core.feed(GuardActed(), drive.now)
    drive.tick()
    assert len(drive.releases) == 1
    assert drive.core.phase is Phase.RELEASING
    drive.release_ends()
    drive.run(0.1)
    assert drive.core.phase is Phase.FREE
    assert drive.put().token == Token.NOT_LEASED
    assert any(report.action == "release" for report in drive.of(ReportFailsafe))


@pytest.mark.parametrize("stall", [CFG.limiter.setpoint_ttl - 0.05, 0.35, 1.0, 30.0])
def test_after_a_stall_longer_than_a_setpoint_lives_the_release_comes_before_any_stick_frame(drive, stall):
    drive.fly()
    drive.put(pitch=40.0)
    drive.now += stall
    drive.put(pitch=40.0)
    drive.tick()
    if stall < CFG.limiter.setpoint_ttl:
        assert drive.core.phase is Phase.FLYING
    else:
        assert drive.sticks == []
        assert ["did not run" in release.reason for release in drive.releases] == [True]
