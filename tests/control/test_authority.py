"""Who may fly: the lease, its stream and its key, and what a tick decides; every limit on both its sides."""

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
from mkdaemon.telemetry.signature import Signature, signed

CFG = ControlConfig()
PAUSE = 1.0 / CFG.lease.engage_rate
"""Longest time between two setpoints of a stream that lives [s]."""
SIGNED = signed("secret", "setpoint/stick", b"")


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

    def send(self, ttl=0.3):
        self.sequence += 1
        new = setpoint(self.sequence, ttl=ttl)
        self.authority.check_setpoint(new, 7).take_setpoint(new, CFG.lease, self.now)

    def fly(self):
        for _ in range(12):
            self.send()
            decision = self.tick(self.now)
            self.now = round(self.now + 0.1, 6)
        assert isinstance(decision, Fly)
        return self


def refused(call):
    with pytest.raises(CommandRejectedError) as caught:
        call()
    return caught.value.token


def test_without_a_lease_nobody_has_a_key_and_nothing_is_flown():
    free = Authority(CFG, first_epoch=7)
    assert (free.lease(0.0), free.setpoint_age(0.0), free.holder_key, free.deadline()) == (None,) * 4
    assert refused(lambda: free.check_setpoint(setpoint(), 7)) == "not_leased"
    assert refused(lambda: free.give_back(7, "secret")) == "not_leased"


@pytest.mark.parametrize(("asked", "ttl"), [(None, CFG.lease.ttl), (1.0, 1.0), (60.0, CFG.lease.ttl)])
def test_a_client_may_ask_for_a_shorter_life_but_not_a_longer_one(asked, ttl):
    granted = Authority(CFG, first_epoch=7).take("alice", "secret", 0.0, ttl=asked)
    assert (granted.holder, granted.epoch, granted.ttl, granted.left) == ("alice", 7, ttl, ttl)


def test_only_the_grant_shows_the_secret_and_every_lease_has_an_epoch_and_a_secret_of_its_own():
    authority = Authority(CFG, first_epoch=1)
    first, second = authority.take("alice", "of the first", 0.0), authority.take("alice", "of the second", 0.0)
    assert (first.secret, second.secret, first.epoch, second.epoch) == ("of the first", "of the second", 1, 2)
    shown = authority.lease(0.0), authority.renew(2, "of the second", 0.0)
    assert not any("secret" in lease.model_dump() for lease in shown)


@pytest.mark.parametrize(
    "signature",
    [
        Signature("setpoint/stick", b"", b""),
        signed("guessed", "setpoint/stick", b""),
        Signature("setpoint/stick", b"another payload", SIGNED.proof),
        Signature("setpoint/attitude", b"", SIGNED.proof),
        Signature("setpoint/stick", b"", SIGNED.proof[:-1]),
    ],
    ids=["none", "another secret", "another payload", "another key", "cut"],
)
def test_the_key_of_a_lease_identifies_its_holder_alone(signature):
    key = Desk().authority.holder_key
    assert (key.epoch_signed(SIGNED), key.epoch_signed(signature)) == (7, None)
    assert "secret" not in repr(key)


def test_the_holder_alone_renews_an_unused_lease_which_ends_without_a_sign_of_life():
    desk = Desk()
    assert refused(lambda: desk.authority.renew(7, "guessed", 11.0)) == "not_holder"
    assert refused(lambda: desk.authority.give_back(7, "")) == "not_holder"
    assert refused(lambda: desk.authority.renew(8, "secret", 11.0)) == "wrong_epoch"
    assert desk.authority.renew(7, "secret", 14.0).left == CFG.lease.ttl
    desk.tick(13.9 + CFG.lease.ttl)
    assert desk.authority.phase is Phase.LEASED
    order = desk.tick(14.0 + CFG.lease.ttl)
    assert (order.holder, order.asked) == ("alice", False)
    assert "no sign of life from alice" in order.reason


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
    assert (desk.authority.reason, desk.authority.progress) == ("alice streams; no target", None)
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


@pytest.mark.parametrize("life", [0.2, 0.3])
def test_the_deadline_is_when_silence_changes_what_is_sent_and_a_setpoint_in_time_is_flown_again(life):
    desk = Desk()
    assert desk.authority.deadline() is None
    desk.send()
    assert desk.authority.deadline() is None, "nothing is sent yet"
    desk.fly()
    arrived = desk.now
    desk.send(life)
    assert desk.authority.deadline() == pytest.approx(arrived + life)
    desk.tick(arrived + life + 1e-3)
    assert desk.authority.phase is Phase.STALE
    assert desk.authority.deadline() == pytest.approx(arrived + CFG.lease.release_after)
    desk.now = arrived + 0.5
    desk.send()
    assert isinstance(desk.tick(desk.now + 0.02), Fly)
    assert desk.authority.phase is Phase.FLYING
    assert desk.authority.setpoint_age(desk.now + 0.02) == pytest.approx(0.02)


def test_a_stranger_who_knows_the_epoch_neither_flies_nor_keeps_the_lease_alive():
    desk = Desk()
    assert desk.authority.refuse_unsigned(setpoint()).token == "not_holder"
    assert desk.authority.refuse_unsigned(setpoint(epoch=6)).token == "wrong_epoch"
    assert refused(lambda: desk.authority.check_setpoint(setpoint(), 6)) == "not_holder"
    assert not desk.authority.is_resumed_by(setpoint()), "nothing was aborted"
    desk.send()
    assert refused(lambda: desk.authority.check_setpoint(setpoint(1), 7)) == "stale_sequence"
    desk.authority.refuse_setpoint(setpoint(5), 11.0, goes_on=False)
    desk.authority.refuse_setpoint(setpoint(9, epoch=6), 99.0, goes_on=False)
    assert desk.authority.lease(11.0).left == CFG.lease.ttl, "another lease's setpoint is no sign of life"
