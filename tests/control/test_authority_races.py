"""Who flies is always who holds the lease, whatever happens in whatever order."""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from mkdaemon.control.authority import Fly, ReleaseOrder
from mkdaemon.control.modes import Trigger
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import Phase
from tests.control.test_authority import CFG, SECRET, TICK, authority, decide, offer, setpoint


class Race(RuleBasedStateMachine):
    """Two clients, a dying line and a slow release, in any order: who flies is always who holds the lease."""

    def __init__(self) -> None:
        super().__init__()
        self.authority = authority(1)
        self.now = 0.0
        self.epochs: dict[str, int] = {}
        self.sequence = 0
        self.newest_epoch = 0
        self.releasing = False
        self.last_offer: dict[int, float] = {}

    @rule(who=st.sampled_from(["alice", "bob"]), force=st.booleans())
    def take(self, who, force):
        held = self.authority.lease(self.now)
        is_busy = self.authority.phase is Phase.RELEASING if held is None else held.left > 0 and not force
        if is_busy:  # admission refuses that: `lease_held`, `busy`
            return
        lease = self.authority.take(who, SECRET, self.now)
        assert lease.epoch > self.newest_epoch
        self.epochs[who] = self.newest_epoch = lease.epoch

    @rule(who=st.sampled_from(["alice", "bob"]), pitch=st.sampled_from([0.0, 30.0]), times=st.integers(1, 80))
    @precondition(lambda self: self.epochs)
    def stream(self, who, pitch, times):
        for _ in range(times):
            epoch = self.epochs.get(who, 0)
            self.sequence += 1
            held = self.authority.lease(self.now)
            try:
                offer(self.authority, setpoint(epoch, self.sequence, pitch=pitch), self.now, epoch)
            except CommandRejectedError as error:
                assert error.token in {"not_leased", "wrong_epoch"}
                assert held is None or held.epoch != epoch
            else:
                self.last_offer[epoch] = self.now
            self.tick()

    @rule(times=st.integers(1, 100))
    def wait(self, times):
        for _ in range(times):
            self.tick()

    @rule(who=st.sampled_from(["alice", "bob"]))
    def die(self, who):
        self.authority.client_gone(who)

    @rule(reason=st.just("line lost"))
    def end(self, reason):
        self.authority.end(Trigger.LINK_LOST, cause=reason)

    @rule()
    def released(self):
        if self.releasing:
            self.releasing = False
            self.authority.released(self.now)

    def tick(self):
        held = self.authority.lease(self.now)
        action = decide(self.authority, self.now)
        if isinstance(action, ReleaseOrder):
            self.releasing = True
        if isinstance(action, Fly):
            assert not self.releasing, "sticks during a release"
            assert held is not None
            assert action.epoch == held.epoch
            assert action.epoch == max(self.epochs.values()), "a frame of an old epoch"
            silence = self.now - self.last_offer[action.epoch]
            assert action.age == pytest.approx(silence)
            assert silence < CFG.lease.release_after
        self.now += TICK

    @invariant()
    def phases_agree_with_the_lease(self):
        if self.authority.phase in {Phase.FREE}:
            assert self.authority.lease(self.now) is None


TestRace = Race.TestCase
TestRace.settings = settings(stateful_step_count=30, deadline=None)
