"""The lease and its stream by themselves, and what a tick shows: every limit on both its sides, without a flight."""

from __future__ import annotations

import pytest

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.authority import LONGEST_JUMP, Authority, Fly, HeldLease, ReleaseOrder
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.manoeuvre import Step, ended
from mkdaemon.control.modes import Trigger
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Outcome, Phase, Progress
from mkdaemon.telemetry.setpoint import HoldSetpoint

CFG = ControlConfig()
PAUSE = 1.0 / CFG.lease.engage_rate
"""Longest time between two setpoints of a stream that lives [s]."""


def setpoint(sequence=1, *, epoch=7, ttl=0.3):
    return HoldSetpoint(epoch=epoch, sequence=sequence, ttl=ttl)


def lease(**fields):
    return HeldLease("alice", 7, "secret", 5.0, **{"sign_of_life": 10.0, "since": 10.0, "arrived": 10.0} | fields)


@pytest.mark.parametrize(("now", "left"), [(10.0, 5.0), (12.0, 3.0), (15.0, 0.0), (16.0, 0.0)])
def test_what_is_left_counts_from_the_last_sign_of_life_and_is_never_negative(now, left):
    shown = lease().shown(now)
    assert (shown.holder, shown.epoch, shown.ttl, shown.left) == ("alice", 7, 5.0, left)


@pytest.mark.parametrize(
    ("last", "sequence", "token"),
    [
        (None, 0, None),
        (None, 10**6, None),
        (5, 6, None),
        (5, 5, "stale_sequence"),
        (5, 4, "stale_sequence"),
        (5, 5 + LONGEST_JUMP, None),
        (5, 6 + LONGEST_JUMP, "sequence_jump"),
    ],
)
def test_a_setpoint_is_newer_than_the_last_one_and_not_unbelievably_so(last, sequence, token):
    held = lease(sequence=last)
    if token is None:
        held.check_setpoint(setpoint(sequence))
        return
    with pytest.raises(CommandRejectedError) as caught:
        held.check_setpoint(setpoint(sequence))
    assert caught.value.token == token


def test_a_jump_is_two_hundred_seconds_of_a_stream_at_most():
    assert LONGEST_JUMP / 50.0 == 200.0


@pytest.mark.parametrize(("gap", "since"), [(0.02, 10.0), (PAUSE, 10.0), (PAUSE + 1e-6, 11.0 + PAUSE + 1e-6)])
def test_a_stream_lives_on_over_a_pause_of_its_slowest_rate_and_anew_after_a_longer_one(gap, since):
    held = lease()
    assert held.take_setpoint(setpoint(1), CFG.lease, 10.0) is True
    for k in (1, 2):
        assert held.take_setpoint(setpoint(1 + k), CFG.lease, 10.0 + 0.5 * k) is False
    assert held.take_setpoint(setpoint(4), CFG.lease, 11.0 + gap) is False
    assert held.since == since
    assert (held.arrived, held.sign_of_life, held.sequence) == (11.0 + gap, 11.0 + gap, 4)
    assert held.newest == setpoint(4)


def test_the_first_setpoint_begins_the_stream_however_long_the_lease_was_idle():
    held = lease()
    held.take_setpoint(setpoint(1), CFG.lease, 10.3)
    assert held.since == 10.3


@pytest.mark.parametrize(
    ("arrived", "now", "is_live"),
    [
        (11.0, 11.0, True),
        (11.0 - 1e-6, 11.0, False),
        (11.0, 11.0 + PAUSE, True),
        (11.0, 11.0 + PAUSE + 1e-6, False),
        (13.0, 13.0 + 0.9 * PAUSE, True),
    ],
)
def test_a_stream_is_live_when_it_has_lived_a_second_and_its_newest_setpoint_is_no_older_than_a_pause(
    arrived, now, is_live
):
    assert lease(arrived=arrived).is_live(CFG.lease, now) is is_live


@pytest.mark.parametrize(
    ("goes_on", "has_newest", "arrived"), [(True, True, 12.0), (False, True, 10.0), (True, False, 10.0)]
)
def test_a_refused_setpoint_is_spent_and_keeps_only_a_flight_that_holds_its_place_alive(goes_on, has_newest, arrived):
    held = lease(newest=setpoint(1) if has_newest else None, sequence=1)
    held.refuse_setpoint(setpoint(2), 12.0, goes_on=goes_on)
    assert (held.sign_of_life, held.sequence, held.arrived) == (12.0, 2, arrived)
    assert held.newest == (setpoint(1) if has_newest else None), "what was refused is not flown"


@pytest.mark.parametrize(("ttl", "life"), [(0.1, 0.1), (1.0, CFG.limiter.setpoint_ttl)])
def test_a_setpoint_holds_as_long_as_it_says_and_no_longer_than_the_daemon_lets_it(ttl, life):
    assert lease(newest=setpoint(ttl=ttl)).setpoint_life(CFG.limiter) == life


def test_setpoints_alone_break_the_silence_in_flight():
    held = lease(arrived=10.0, sign_of_life=11.0)
    assert held.silence(12.0, is_in_flight=True) == 2.0
    assert held.silence(12.0, is_in_flight=False) == 1.0


# -- the authority over it -------------------------------------------------------------------------------------------


class Desk:
    """An authority that decides by what the test wants."""

    def __init__(self):
        self.step = Step(Sticks(0.0, 0.0, 0.0, 10.0), "hold", stage="holds", is_done=True)
        self.asked = []
        self.authority = Authority(CFG, first_epoch=7)
        self.authority.take("alice", "secret", 10.0)
        self.now, self.sequence = 10.0, 0

    def tick(self, now):
        """Decide by what the test wants, where a setpoint is to be decided by."""
        newest = self.authority.newest
        if newest is not None:
            self.asked.append((newest.sequence, self.authority.phase))
        return self.authority.tick(None if newest is None else self.step, now)

    def send(self):
        self.sequence += 1
        new = setpoint(self.sequence)
        self.authority.check_setpoint(new, 7).take_setpoint(new, CFG.lease, self.now)

    def fly(self):
        for _ in range(12):
            self.send()
            decision = self.tick(self.now)
            self.now = round(self.now + 0.1, 6)
        assert isinstance(decision, Fly)
        return self


def test_sticks_carry_the_age_the_life_the_lease_and_the_number_of_their_setpoint():
    desk = Desk().fly()
    desk.send()
    decision = desk.tick(desk.now + 0.05)
    assert decision == Fly(desk.step.sticks, pytest.approx(0.05), 0.3, 7, 13)
    assert desk.asked[-1] == (13, Phase.FLYING)


def test_what_is_flown_is_shown_while_its_sticks_are_sent():
    desk = Desk()
    assert desk.authority.progress is None
    desk.fly()
    assert desk.authority.progress == Progress("hold", "holds", True)
    desk.authority.end(Trigger.RELEASE_REQUESTED, cause="asked")
    desk.tick(desk.now)
    desk.tick(desk.now)
    assert desk.authority.progress is None


def test_before_the_flight_nothing_is_flown_and_nothing_is_shown():
    desk = Desk()
    desk.send()
    assert desk.tick(desk.now) is None
    assert desk.authority.progress is None
    assert desk.authority.phase is Phase.LEASED


@pytest.mark.parametrize(("outcome", "asked"), [(Outcome.LANDED, True), (Outcome.SIGHT_LOST, False)])
def test_a_manoeuvre_that_ends_by_itself_releases_and_what_was_flown_stays_shown(outcome, asked):
    desk = Desk().fly()
    words = {"target": "pad", "age": 3.0}
    desk.step = Step(desk.step.sticks, "hold", end=ended(outcome, **words))
    desk.send()
    decision = desk.tick(desk.now)
    assert decision == ReleaseOrder(ended(outcome, **words).words, "alice", asked)
    assert desk.authority.outcome is outcome
    assert desk.authority.progress == Progress("hold", "holds", True)
    assert desk.authority.lease(desk.now) is None
    desk.authority.released(desk.now)
    desk.authority.take("bob", "other", desk.now)
    assert desk.authority.outcome is None


def test_an_end_before_the_flight_ends_nothing():
    desk = Desk()
    desk.step = Step(desk.step.sticks, "hold", obstacle="no target", end=ended(Outcome.NO_TARGET))
    for _ in range(20):
        desk.send()
        assert desk.tick(desk.now) is None
        desk.now += 0.1
    assert desk.authority.reason == "alice streams; no target"
    assert desk.authority.outcome is None


@pytest.mark.parametrize(("quiet", "ends"), [(0.99, False), (1.0, True)])
def test_silence_in_flight_is_told_with_its_length(quiet, ends):
    desk = Desk().fly()
    desk.send()
    decision = desk.tick(desk.now + quiet)
    assert isinstance(decision, ReleaseOrder) is ends
    assert not ends or decision == ReleaseOrder("no setpoint from alice for 1.00 s", "alice", False)
    assert (desk.authority.lease(desk.now) is None) is ends


def test_a_low_battery_lands_with_the_lease_or_releases_without_a_target():
    for can_land in (True, False):
        desk = Desk().fly()
        desk.send()
        desk.authority.end(Trigger.BATTERY_LOW, cause="it is low.", can_land=can_land)
        decision = desk.tick(desk.now)
        assert isinstance(decision, Fly if can_land else ReleaseOrder)
        assert desk.authority.phase is (Phase.LANDING if can_land else Phase.RELEASING)
        assert desk.authority.reason.startswith("it is low. ")
    desk = Desk()
    desk.authority.end(Trigger.BATTERY_LOW, cause="it is low.", can_land=True)
    assert desk.authority.phase is Phase.LEASED, "on the ground it ends nothing"


def test_after_a_release_who_took_the_lease_meanwhile_has_its_whole_life():
    desk = Desk().fly()
    desk.authority.take("bob", "other", desk.now)
    assert isinstance(desk.tick(desk.now), ReleaseOrder)
    assert desk.authority.holder_key.secret == "other"
    desk.authority.released(desk.now + 4.0)
    assert desk.authority.phase is Phase.LEASED
    assert desk.authority.lease(desk.now + 4.0).left == CFG.lease.ttl


def test_the_deadline_is_when_silence_changes_what_is_sent():
    desk = Desk()
    assert desk.authority.deadline() is None
    desk.send()
    assert desk.authority.deadline() is None, "nothing is sent yet"
    desk.fly()
    arrived = desk.now - 0.1
    assert desk.authority.deadline() == pytest.approx(arrived + 0.3)
    desk.tick(arrived + 0.5)
    assert desk.authority.phase is Phase.STALE
    assert desk.authority.deadline() == pytest.approx(arrived + CFG.lease.release_after)


def test_refusals_are_counted_whoever_sent_what_was_refused():
    desk = Desk()
    assert desk.authority.refuse_unsigned(setpoint()).token == "not_holder"
    assert desk.authority.refuse_unsigned(setpoint(epoch=6)).token == "wrong_epoch"
    with pytest.raises(CommandRejectedError):
        desk.authority.check_setpoint(setpoint(), 6)
    desk.authority.refuse_setpoint(setpoint(5), 11.0, goes_on=False)
    desk.authority.refuse_setpoint(setpoint(9, epoch=6), 99.0, goes_on=False)
    assert desk.authority.lease(11.0).left == CFG.lease.ttl, "another lease's setpoint is no sign of life"


def test_a_release_that_is_asked_for_again_is_not_over_with_the_first():
    desk = Desk().fly()
    desk.authority.end(Trigger.RELEASE_REQUESTED, cause="first")
    desk.tick(desk.now)
    desk.authority.end(Trigger.RELEASE_REQUESTED, cause="second")
    desk.authority.released(desk.now)
    assert desk.authority.phase is Phase.RELEASING, "the second has not been sent yet"
    assert desk.tick(desk.now) == ReleaseOrder("second", "", True)
    desk.authority.released(desk.now)
    assert desk.authority.phase is Phase.FREE
