"""The flight core among clients, a dying line and slow releases, in any order."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from mkdaemon.control.actions import ReleaseAircraft, ReportMode, SendSticks
from mkdaemon.control.events import ClientGone, LineChanged, LinkVerdict
from mkdaemon.control.output import SHORTEST_STEP
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import ControlLine, Obstacle, Phase, ReleaseOutcome
from mkdaemon.telemetry.link import LinkCondition
from tests.control.events import CFG, PERIOD, Driver, link_state


class Race(RuleBasedStateMachine):
    """Everything that can happen to a core, and what must hold whatever happens."""

    def __init__(self) -> None:
        super().__init__()
        self.drive = Driver()
        self.epochs: dict[str, int] = {}
        self.secrets: dict[str, str] = {}
        self.is_releasing = False
        self.last_frame = float("-inf")
        self.phase = Phase.FREE

    @rule(who=st.sampled_from(["alice", "bob"]), force=st.booleans())
    def take(self, who, force):
        try:
            granted = self.drive.request(holder=who, force=force)
        except CommandRejectedError as error:
            assert error.token in {"lease_held", "busy", "no_control", "link_down"}
        else:
            assert granted.epoch > max(self.epochs.values(), default=0)
            self.epochs[who], self.secrets[who] = granted.epoch, granted.secret

    @rule(who=st.sampled_from(["alice", "bob"]), pitch=st.sampled_from([0.0, 30.0]), times=st.integers(1, 80))
    def stream(self, who, pitch, times):
        self.drive.secret = self.secrets.get(who, "")
        for _ in range(times):
            refusal = self.drive.put(epoch=self.epochs.get(who, 0), pitch=pitch)
            assert refusal is None or refusal.token in {"not_leased", "wrong_epoch"}
            self.run_for(PERIOD)

    @rule(who=st.sampled_from(["alice", "bob"]))
    def fly(self, who):
        """All is well, and one of them takes the lease and streams until sticks are sent."""
        self.change_link(LinkCondition.UP, 1)
        self.change_line(None)
        self.run_for(PERIOD)
        self.end_release(ReleaseOutcome.CONFIRMED)
        self.take(who, force=True)
        self.run_for(PERIOD)
        self.end_release(ReleaseOutcome.CONFIRMED)
        self.stream(who, 0.0, 60)

    @rule(seconds=st.floats(0.001, 2.0))
    def wait(self, seconds):
        self.run_for(seconds)

    @rule(who=st.sampled_from(["alice", "bob"]))
    def lose_client(self, who):
        self.drive.core.feed(ClientGone(who), 0.0)

    @rule()
    def ask_release(self):
        self.drive.ask_release()

    @rule(outcome=st.sampled_from([*ReleaseOutcome, None]))
    def end_release(self, outcome):
        if self.is_releasing:
            self.is_releasing = False
            self.drive.release_ends(outcome)

    @rule(condition=st.sampled_from(list(LinkCondition)), openings=st.sampled_from([1, 1, 1, 2]))
    def change_link(self, condition, openings):
        self.drive.core.feed(LinkVerdict(link_state(condition, openings=openings)), 0.0)

    @rule(obstacle=st.sampled_from([None, None, None, *Obstacle]))
    def change_line(self, obstacle):
        layout = None if obstacle is Obstacle.READ_ONLY else "v2"
        self.drive.core.feed(LineChanged(ControlLine(layout, obstacle, "test")), 0.0)

    def run_for(self, seconds):
        before = len(self.drive.done)
        self.drive.run(seconds)
        for at, action in self.drive.done[before:]:
            self.check(at, action)

    def check(self, at, action):
        match action:
            case SendSticks():
                assert not self.is_releasing, "sticks during a release"
                assert action.epoch == max(self.epochs.values()), "a frame of an old epoch"
                assert at - self.last_frame >= SHORTEST_STEP - 1e-9
                assert action.age < CFG.lease.release_after
                if action.age > CFG.limiter.setpoint_ttl:
                    assert (action.counts.pitch, action.counts.roll, action.counts.yaw) == (0, 0, 0)
                assert action.deadline > at
                self.last_frame = at
            case ReleaseAircraft():
                assert not self.is_releasing, "one release at a time"
                self.is_releasing = True
            case ReportMode():
                assert action.before is self.phase, "a change of phase was not reported"
                self.phase = action.after
            case _:
                pass

    @invariant()
    def nobody_is_free_with_a_lease(self):
        if self.drive.core.phase is Phase.FREE:
            assert self.drive.request("show") is None

    @invariant()
    def a_tick_is_never_due_twice_without_news(self):
        self.run_for(0.0)
        assert self.drive.core.next_time() > self.drive.now


TestRace = Race.TestCase
TestRace.settings = settings(stateful_step_count=30, deadline=None)
