"""Who may fly: the lease, the ladder from setpoint to release, and races for both."""

from __future__ import annotations

import pytest

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.authority import LONGEST_JUMP, Authority, Fly, ReleaseOrder
from mkdaemon.control.modes import IN_FLIGHT, Trigger
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import StickSetpoint
from mkdaemon.telemetry.signature import Signature, signed
from tests.control.flying import Flying

CFG = ControlConfig()
TICK = 0.02


def follow(setpoint, phase, now):
    flying = Flying(CFG)
    flying.step(setpoint, now)
    return flying.step(setpoint, now, is_flying=phase in IN_FLIGHT)


def offer(authority, setpoint, now, signed_for):
    """Bring a setpoint as the core does; returns whether it is the first of its epoch."""
    return authority.check_setpoint(setpoint, signed_for).take_setpoint(setpoint, CFG.lease, now)


def setpoint(epoch, sequence, *, pitch=0.0, ttl=0.3):
    return StickSetpoint(epoch=epoch, sequence=sequence, ttl=ttl, pitch=pitch, roll=0.0, yaw=0.0, throttle=10.0)


SECRET = "known to the holder alone"
SIGNED = signed(SECRET, "setpoint/stick", b"")


def authority(first_epoch):
    return Authority(CFG, first_epoch=first_epoch)


def decide(authority, now):
    """Let an authority decide by the sticks of its newest setpoint, as the core does."""
    newest = authority.newest
    return authority.tick(None if newest is None else follow(newest, authority.phase, now), now)


class Cockpit:
    """An authority driven through time, as the daemon drives it."""

    def __init__(self) -> None:
        self.authority = authority(100)
        self.now = 0.0
        self.sequence = 0
        self.actions: list[tuple[float, Fly | ReleaseOrder]] = []

    def stream(self, seconds, epoch, *, pitch=0.0, ttl=0.3, rate=50.0):
        """Setpoints at a rate, ticks in between."""
        end = self.now + seconds
        next_setpoint = self.now
        while self.now < end:
            if self.now >= next_setpoint:
                self.sequence += 1
                offer(self.authority, setpoint(epoch, self.sequence, pitch=pitch, ttl=ttl), self.now, epoch)
                next_setpoint += 1 / rate
            self.pass_time(TICK)

    def pass_time(self, seconds):
        """Ticks without setpoints."""
        for _ in range(round(seconds / TICK)):
            action = decide(self.authority, self.now)
            if action is not None:
                self.actions.append((self.now, action))
            self.now += TICK

    def fly(self):
        """Take the lease and stream until sticks are sent; returns the epoch."""
        lease = self.authority.take("alice", SECRET, self.now)
        self.stream(1.2, lease.epoch)
        assert self.authority.phase is Phase.FLYING
        self.actions.clear()
        return lease.epoch

    @property
    def flown(self):
        return [(t, action) for t, action in self.actions if isinstance(action, Fly)]

    @property
    def releases(self):
        return [(t, action) for t, action in self.actions if isinstance(action, ReleaseOrder)]


@pytest.fixture
def cockpit():
    return Cockpit()


def refused(call, token):
    with pytest.raises(CommandRejectedError) as caught:
        call()
    assert caught.value.token == token
    return caught.value


# -- the lease -----------------------------------------------------------------------------------------------------


def test_without_a_lease_nothing_is_sent(cockpit):
    refused(lambda: offer(cockpit.authority, setpoint(100, 1), 0.0, 100), "not_leased")
    cockpit.pass_time(3.0)
    assert cockpit.actions == []
    assert cockpit.authority.phase is Phase.FREE
    assert cockpit.authority.lease(cockpit.now) is None
    assert cockpit.authority.setpoint_age(cockpit.now) is None


def test_the_lease_is_shown_with_the_time_that_is_left(cockpit):
    lease = cockpit.authority.take("alice", SECRET, 0.0)
    assert (lease.holder, lease.epoch, lease.ttl, lease.left) == ("alice", 100, CFG.lease.ttl, CFG.lease.ttl)
    assert cockpit.authority.lease(1.0).left == CFG.lease.ttl - 1.0


def test_a_client_may_ask_for_a_shorter_life_but_not_a_longer_one(cockpit):
    assert cockpit.authority.take("alice", SECRET, 0.0, ttl=1.0).ttl == 1.0
    assert cockpit.authority.take("alice", SECRET, 0.0, ttl=60.0).ttl == CFG.lease.ttl


def test_an_unused_lease_ends_by_itself_and_the_aircraft_is_released(cockpit):
    cockpit.authority.take("alice", SECRET, 0.0)
    cockpit.pass_time(CFG.lease.ttl + 0.1)
    [(t, release)] = cockpit.releases
    assert t == pytest.approx(CFG.lease.ttl, abs=TICK)
    assert (release.holder, release.asked) == ("alice", False)
    assert "no sign of life from alice" in release.reason
    assert cockpit.authority.phase is Phase.RELEASING
    cockpit.authority.released(cockpit.now)
    assert cockpit.authority.phase is Phase.FREE


def test_renewal_keeps_an_unused_lease(cockpit):
    epoch = cockpit.authority.take("alice", SECRET, 0.0).epoch
    for _ in range(4):
        cockpit.pass_time(CFG.lease.ttl * 0.9)
        assert cockpit.authority.renew(epoch, SECRET, cockpit.now).left == pytest.approx(CFG.lease.ttl)
    assert cockpit.actions == []
    refused(lambda: cockpit.authority.renew(epoch + 1, SECRET, cockpit.now), "wrong_epoch")


def test_a_lease_that_has_run_out_can_be_taken_before_any_tick_noticed(cockpit):
    cockpit.authority.take("alice", SECRET, 0.0)
    assert cockpit.authority.take("bob", SECRET, CFG.lease.ttl + 1).holder == "bob"


def test_giving_back_releases_and_wants_the_right_epoch(cockpit):
    epoch = cockpit.fly()
    refused(lambda: cockpit.authority.give_back(epoch - 1, SECRET), "wrong_epoch")
    cockpit.authority.give_back(epoch, SECRET)
    cockpit.pass_time(0.1)
    [(_, release)] = cockpit.releases
    assert release.asked
    assert cockpit.flown == []
    refused(lambda: cockpit.authority.give_back(epoch, SECRET), "not_leased")


def test_every_lease_has_an_epoch_of_its_own_also_for_the_same_holder(cockpit):
    first = cockpit.fly()
    second = cockpit.authority.take("alice", SECRET, cockpit.now).epoch
    assert second > first
    refused(lambda: offer(cockpit.authority, setpoint(first, 10_000), cockpit.now, first), "wrong_epoch")


def test_a_stranger_who_knows_the_epoch_neither_flies_nor_ends_the_lease(cockpit):
    epoch = cockpit.fly()
    last = cockpit.sequence
    refused(lambda: offer(cockpit.authority, setpoint(epoch, last + 1), cockpit.now, epoch - 1), "not_holder")
    assert cockpit.authority.refuse_unsigned(setpoint(epoch, 2**62)).token == "not_holder"
    refused(lambda: cockpit.authority.renew(epoch, "guessed", cockpit.now), "not_holder")
    refused(lambda: cockpit.authority.give_back(epoch, ""), "not_holder")
    assert not offer(cockpit.authority, setpoint(epoch, last + 1), cockpit.now, epoch)


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
def test_the_key_of_a_lease_knows_its_holder_alone(cockpit, signature):
    assert cockpit.authority.holder_key is None
    epoch = cockpit.authority.take("alice", SECRET, 0.0).epoch
    key = cockpit.authority.holder_key
    assert key.epoch_signed(SIGNED) == epoch
    assert key.epoch_signed(signature) is None
    assert SECRET not in repr(key)


def test_a_sequence_that_jumps_is_refused_and_not_believed(cockpit):
    epoch = cockpit.authority.take("alice", SECRET, 0.0).epoch
    assert offer(cockpit.authority, setpoint(epoch, 5), 0.0, epoch)
    refused(lambda: offer(cockpit.authority, setpoint(epoch, 6 + LONGEST_JUMP), 0.1, epoch), "sequence_jump")
    assert not offer(cockpit.authority, setpoint(epoch, 6), 0.1, epoch)
    assert not offer(cockpit.authority, setpoint(epoch, 6 + LONGEST_JUMP), 0.1, epoch)


def test_only_the_grant_shows_the_secret_and_every_lease_has_another():
    authority = Authority(CFG, first_epoch=1)
    first = authority.take("alice", "of the first", 0.0)
    second = authority.take("bob", "of the second", 0.0)
    assert (first.secret, second.secret) == ("of the first", "of the second")
    assert "secret" not in authority.lease(0.0).model_dump()
    assert "secret" not in authority.renew(second.epoch, second.secret, 0.0).model_dump()


# -- engaging ------------------------------------------------------------------------------------------------------


def test_nothing_is_sent_before_the_stream_has_lived_a_second(cockpit):
    epoch = cockpit.authority.take("alice", SECRET, 0.0).epoch
    cockpit.stream(CFG.lease.engage_after - TICK, epoch)
    assert cockpit.actions == []
    cockpit.stream(0.2, epoch)
    t, first = cockpit.flown[0]
    assert t == pytest.approx(CFG.lease.engage_after, abs=2 * TICK)
    assert (first.epoch, first.age) == (epoch, 0.0)


def test_sticks_must_be_neutral_to_engage(cockpit):
    epoch = cockpit.authority.take("alice", SECRET, 0.0).epoch
    cockpit.stream(3.0, epoch, pitch=CFG.lease.neutral_band + 0.1)
    assert cockpit.actions == []
    assert "neutral" in cockpit.authority.reason
    cockpit.stream(0.1, epoch, pitch=CFG.lease.neutral_band)
    assert cockpit.flown
    cockpit.stream(0.1, epoch, pitch=50.0)
    assert cockpit.flown[-1][1].sticks.pitch == 50.0


def test_a_stream_with_gaps_is_not_live(cockpit):
    epoch = cockpit.authority.take("alice", SECRET, 0.0).epoch
    cockpit.stream(4.0, epoch, rate=0.9 * CFG.lease.engage_rate)
    assert cockpit.actions == []


def test_a_stream_that_has_just_stopped_does_not_engage(cockpit):
    epoch = cockpit.authority.take("alice", SECRET, 0.0).epoch
    cockpit.stream(0.9, epoch)
    cockpit.pass_time(2.0)
    assert cockpit.flown == []


# -- the ladder ----------------------------------------------------------------------------------------------------


def test_silence_goes_stale_then_releases_then_nothing(cockpit):
    epoch = cockpit.fly()
    stopped = cockpit.now - TICK  # the last setpoint's arrival
    cockpit.pass_time(3.0)
    ages = [(t, fly.age, fly.ttl) for t, fly in cockpit.flown]
    stale = [t for t, age, ttl in ages if age > ttl]
    assert stale[0] - stopped == pytest.approx(CFG.limiter.setpoint_ttl, abs=2 * TICK)
    [(released_at, release)] = cockpit.releases
    assert released_at - stopped == pytest.approx(CFG.lease.release_after, abs=2 * TICK)
    assert "no setpoint from alice" in release.reason
    assert not release.asked
    assert max(t for t, _ in cockpit.flown) < released_at
    refused(lambda: offer(cockpit.authority, setpoint(epoch, 10_000), cockpit.now, epoch), "not_leased")


def test_a_setpoint_in_time_resumes_after_staleness(cockpit):
    epoch = cockpit.fly()
    cockpit.pass_time(0.5)
    assert cockpit.authority.phase is Phase.STALE
    cockpit.stream(0.1, epoch, pitch=5.0)
    assert cockpit.authority.phase is Phase.FLYING
    assert cockpit.releases == []
    assert cockpit.authority.setpoint_age(cockpit.now) == pytest.approx(TICK)


def test_renewal_does_not_replace_setpoints_in_flight(cockpit):
    epoch = cockpit.fly()
    for _ in range(10):
        cockpit.pass_time(0.2)
        if cockpit.releases:
            break
        cockpit.authority.renew(epoch, SECRET, cockpit.now)
    assert len(cockpit.releases) == 1


def test_where_nothing_was_aborted_no_setpoint_ends_an_abort(cockpit):
    plain = setpoint(100, 1)
    assert plain.after_abort == cockpit.authority.aborts == 0
    assert not cockpit.authority.is_resumed_by(plain)


def test_a_setpoints_own_shorter_life_is_honoured(cockpit):
    epoch = cockpit.fly()
    cockpit.stream(TICK, epoch, ttl=0.05)
    cockpit.pass_time(0.1)
    assert cockpit.authority.phase is Phase.STALE


@pytest.mark.parametrize("sequence", [0, 1, 5])
def test_old_and_repeated_sequence_numbers_are_refused(cockpit, sequence):
    epoch = cockpit.authority.take("alice", SECRET, 0.0).epoch
    assert offer(cockpit.authority, setpoint(epoch, 5), 0.0, epoch)
    refused(lambda: offer(cockpit.authority, setpoint(epoch, sequence), 0.1, epoch), "stale_sequence")
    assert not offer(cockpit.authority, setpoint(epoch, 6), 0.1, epoch)


def test_the_death_of_the_holder_releases_at_once(cockpit):
    cockpit.fly()
    cockpit.authority.client_gone("bob")
    cockpit.pass_time(TICK)
    assert cockpit.releases == []
    cockpit.authority.client_gone("alice")
    cockpit.pass_time(TICK)
    [(_, release)] = cockpit.releases
    assert release.reason == "client alice is gone"
    assert not release.asked


def test_the_death_of_somebody_without_lease_means_nothing(cockpit):
    cockpit.authority.client_gone("alice")
    cockpit.pass_time(0.1)
    assert cockpit.actions == []


def test_anybody_may_end_it_even_when_nobody_flies(cockpit):
    cockpit.authority.end(Trigger.RELEASE_REQUESTED, cause="big red button")
    cockpit.pass_time(0.1)
    [(_, release)] = cockpit.releases
    assert (release.reason, release.holder) == ("big red button", "")


# -- releasing -----------------------------------------------------------------------------------------------------


def test_while_releasing_nothing_is_sent(cockpit):
    epoch = cockpit.fly()
    cockpit.authority.give_back(epoch, SECRET)
    cockpit.pass_time(TICK)
    cockpit.pass_time(2.0)
    assert len(cockpit.actions) == 1
    cockpit.authority.released(cockpit.now)
    assert cockpit.authority.take("bob", SECRET, cockpit.now).holder == "bob"


def test_taking_by_force_releases_first_and_the_new_holder_engages_anew(cockpit):
    old = cockpit.fly()
    lease = cockpit.authority.take("bob", SECRET, cockpit.now)
    refused(lambda: offer(cockpit.authority, setpoint(old, 10_000), cockpit.now, old), "wrong_epoch")
    cockpit.stream(1.5, lease.epoch)
    [(_, release)] = cockpit.releases
    assert release.holder == "alice"
    assert cockpit.flown == [], "the release is not done"
    cockpit.authority.released(cockpit.now)
    assert cockpit.authority.phase is Phase.LEASED
    cockpit.stream(0.2, lease.epoch)
    assert {fly.epoch for _, fly in cockpit.flown} == {lease.epoch}


def test_a_second_end_during_a_release_is_carried_out_too(cockpit):
    cockpit.fly()
    cockpit.authority.end(Trigger.RELEASE_REQUESTED, cause="first")
    cockpit.pass_time(TICK)
    cockpit.authority.end(Trigger.RELEASE_REQUESTED, cause="second")
    cockpit.authority.released(cockpit.now)  # of the first
    cockpit.pass_time(TICK)
    assert [release.reason for _, release in cockpit.releases] == ["first", "second"]
    cockpit.authority.released(cockpit.now)
    assert cockpit.authority.phase is Phase.FREE


def test_a_lease_does_not_grow_old_while_the_release_before_it_runs(cockpit):
    cockpit.fly()
    cockpit.authority.take("bob", SECRET, cockpit.now)
    cockpit.pass_time(CFG.lease.ttl + 1)
    assert len(cockpit.releases) == 1
    cockpit.authority.released(cockpit.now)
    assert cockpit.authority.lease(cockpit.now).left == pytest.approx(CFG.lease.ttl)


def test_the_lease_can_change_hands_while_the_release_before_it_runs(cockpit):
    cockpit.fly()
    cockpit.authority.take("bob", SECRET, cockpit.now)
    cockpit.pass_time(TICK)
    epoch = cockpit.authority.take("carol", SECRET, cockpit.now).epoch
    assert cockpit.authority.phase is Phase.RELEASING
    cockpit.pass_time(TICK)
    assert [release.holder for _, release in cockpit.releases] == ["alice", "bob"]
    cockpit.authority.released(cockpit.now)
    cockpit.stream(1.2, epoch)
    assert cockpit.authority.phase is Phase.FLYING


def test_released_out_of_place_changes_nothing(cockpit):
    cockpit.fly()
    cockpit.authority.released(cockpit.now)
    assert cockpit.authority.phase is Phase.FLYING


def test_the_next_deadline_is_that_of_the_phase():
    held = authority(1)
    assert held.deadline() is None
    epoch = held.take("alice", SECRET, 0.0).epoch
    assert held.deadline() is None
    for step in range(1, 201):
        offer(held, setpoint(epoch, step, ttl=0.2), step * TICK, epoch)
        decide(held, step * TICK)
    last = 200 * TICK
    assert held.deadline() == pytest.approx(last + 0.2)
    decide(held, last + 0.201)
    assert held.deadline() == pytest.approx(last + CFG.lease.release_after)
    decide(held, last + CFG.lease.release_after + 0.001)
    assert held.deadline() is None
