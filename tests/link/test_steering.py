"""External control without boards: frames and confirmations, what is queued, and what silence a release brings."""

from __future__ import annotations

import itertools
from functools import partial

import pytest

from lab.rigs.sticks import build_sticks
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.line import FORWARDING_GAP, LineRules
from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.release import GIVE_UP, QUIET_TIME, REMIND, REPEATS, SPACING
from mkdaemon.link.session.scheduler import QueuedTransmission, TransmitScheduler
from mkdaemon.link.session.steering import ControlEntry, ControlPath, Steering
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.messages import DebugRequest, ExternControlV2, VersionFc200
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.control import Obstacle, ReleaseOutcome

STICKS = partial(build_sticks(ExternControlV2, pitch=10, throttle=50), ExternControlV2)


@pytest.fixture
def path() -> ControlPath:
    return ControlPath(HealthMonitor())


def send(path: ControlPath, now: float) -> int:
    entry = path.entry(STICKS, Purpose.SETPOINT, now + 0.1)
    path.sent(entry, now, confirms=True)
    return entry.number


def lost(path: ControlPath, now: float) -> int:
    path._health.confirm.expire(now)
    return path._health.confirm.statistics(now).lost_total


def replaced(path: ControlPath) -> int:
    return path._health.confirm.tally.fates().replaced


@pytest.mark.parametrize(
    ("second_at", "busy", "confirmed_at", "is_replaced"),
    [
        (0.02, [], 0.028, False),
        (0.01, [(0.004, 0.021)], 0.023, True),
        (0.02, [(0.004, 0.021), (0.023, 0.030)], 0.032, True),
        (0.02, [(0.009, 0.013)], 0.029, False),
    ],
    ids=["transmitter free", "behind a long frame", "behind frames on end", "behind a short frame"],
)
def test_a_frame_that_is_not_confirmed_is_lost_and_blames_the_line_unless_another_replaced_it(
    path, second_at, busy, confirmed_at, is_replaced
):
    path.confirmed(99, 0.01)  # a strange one replaces nothing
    first, second = send(path, 0.0), send(path, second_at)
    for stretch in busy:
        path.board_was_busy(*stretch)
    path.confirmed(second, confirmed_at)
    assert first != second
    assert (lost(path, 1.0), replaced(path)) == (1, is_replaced)  # it is counted, with the reason
    assert path._health.confirm.losses(1.0) == (1, 0) if is_replaced else (2, 1)


VERSION_2_08 = VersionFc200.decode(bytes((2, 8, 11, 0, 0, 0, 0, 0, 0, 0, 0, 0)))

VERSION_EARLY = VersionFc200.decode(bytes((0, 71, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0)))


class Bench:
    """A FlightCtrl 2.08 as far as the link knows, and a line on which nothing comes back unless a test says so."""

    def __init__(self, direct: Board = Board.FC) -> None:
        self.now = 0.0
        self.peers = Peers()
        self.peers.note_sender(direct)
        self.peers.learn(Board.FC, VERSION_2_08)
        self.scheduler = TransmitScheduler(LineRules(direct=direct))
        health = HealthMonitor(window=10.0, max_loss_percent=5.0, now=0.0)
        self.steering = Steering(self.scheduler, self.peers, health)
        self.sent: list[tuple[float, QueuedTransmission, WireMessage]] = []

    def run(self, seconds: float, *, answers: bool = False) -> list[tuple[float, QueuedTransmission, WireMessage]]:
        """Send what is due; returns what went out in this time."""
        before, end = len(self.sent), self.now + seconds
        while self.now < end:
            self.steering.step(self.now)
            while (entry := self.scheduler.take(self.now)) is not None:
                assert entry.message is not None
                self.sent.append((self.now, entry, entry.message))
                if isinstance(entry, ControlEntry):
                    self.steering.sent(entry, self.now)
                    if answers:
                        self.steering.confirmed(entry.number, self.now)
            self.now += 0.001
        return self.sent[before:]

    def steer(self) -> None:
        layout = self.peers.dialect.extern_control
        assert layout is not None
        build = partial(build_sticks(layout, pitch=20, throttle=60), layout)
        self.scheduler.submit(self.steering.control.entry(build, Purpose.SETPOINT, self.now + 1.0), self.now)

    def poll_telemetry(self) -> None:
        """Queue a request that keeps the sticks of a 2.08 alive."""
        message = DebugRequest(interval=5)
        self.scheduler.submit(
            QueuedTransmission(message.to_frame(Board.FC), Purpose.REQUEST, 1e9, Board.FC, message, reaches_fc=True),
            self.now,
        )

    def give_up(self) -> None:
        self.steering.release("test", self.now)
        self.run(GIVE_UP + 0.1)
        assert self.steering.plan is not None
        assert self.steering.plan.outcome is ReleaseOutcome.UNCONFIRMED


def test_after_giving_up_nothing_but_config_zero_goes_out_and_rarely():
    bench = Bench()
    bench.steer()
    bench.run(0.1)
    bench.give_up()
    bench.poll_telemetry()
    after = bench.run(QUIET_TIME - 0.2)
    assert {entry.purpose for _, entry, _ in after} == {Purpose.RELEASE}
    assert not any(int(message.config) for _, _, message in after), "a reminder must clear the control it could refresh"
    gaps = [b - a for a, b in itertools.pairwise(at for at, _, _ in after)]
    assert min(gaps) >= REMIND - 0.002
    assert len(after) >= (QUIET_TIME - 0.2) / REMIND - 1
    assert [entry.purpose for _, entry, _ in bench.run(2.0)][-1] is Purpose.REQUEST, "then the line is free again"
    assert bench.run(20.0) == [], "and reminding has an end"


def test_a_board_that_is_back_confirms_a_reminder_is_asked_again_and_may_be_steered_at_once():
    bench = Bench()
    bench.steer()
    bench.run(0.1)
    bench.give_up()
    bench.poll_telemetry()
    bench.run(1.0)
    back = bench.now
    after = bench.run(REMIND + 0.3, answers=True)
    assert bench.steering.plan is not None
    assert bench.steering.plan.outcome is ReleaseOutcome.CONFIRMED
    assert sum(entry.purpose is Purpose.RELEASE for _, entry, _ in after) == REPEATS
    asked = [at for at, entry, _ in after if entry.purpose is Purpose.REQUEST]
    assert asked
    assert asked[0] - back < REMIND + 0.2
    bench.steer()
    assert [entry.purpose for _, entry, _ in bench.run(0.02)] == [Purpose.SETPOINT]


def test_nobody_steers_until_the_release_is_confirmed_or_has_had_its_time():
    bench = Bench()
    bench.give_up()
    for _ in range(10):
        assert bench.steering.obstacle(bench.now) is Obstacle.UNCONFIRMED
        assert {entry.purpose for _, entry, _ in bench.run(0.55)} == {Purpose.RELEASE}, "and reminders go on"
    bench.run(QUIET_TIME - 10 * 0.55)
    assert bench.steering.obstacle(bench.now) is None
    bench.steer()
    assert Purpose.SETPOINT in {entry.purpose for _, entry, _ in bench.run(0.02)}


def test_a_release_outlives_the_end_of_a_redirection_without_waiting_for_what_cannot_come():
    bench = Bench(direct=Board.NC)
    bench.peers.redirected = Board.FC
    assert bench.steering.confirms
    bench.steering.release("test", bench.now)
    bench.run(0.03)
    bench.peers.redirected = None
    bench.steering.redirection_changed()
    began = bench.now
    bench.run(REPEATS * SPACING + 0.1)
    assert bench.steering.plan is not None
    assert bench.steering.plan.result().status == "not_observable"
    assert bench.sent[-1][0] - began < REPEATS * SPACING + 0.05
    bench.steer()  # and is refused no longer


def test_who_confirms():
    steering = Bench(direct=Board.FC).steering
    assert steering.confirms
    bench = Bench(direct=Board.NC)
    assert not bench.steering.confirms
    bench.peers.redirected = Board.FC
    assert bench.steering.confirms
    assert not bench.steering.confirmed(1, 0.0), "the FlightCtrl's word, passed through"
    bench.peers.redirected = None
    assert not bench.steering.confirms
    assert bench.steering.confirmed(2, 0.0)
    assert not bench.steering.confirmed(3, 0.0), "told once"
    assert bench.steering.confirms
    bench.peers.redirected = Board.MAG
    assert not bench.steering.confirms


def test_a_release_under_way_is_not_begun_anew_and_what_waited_to_steer_is_dropped():
    bench = Bench()
    bench.steer()
    bench.steering.release("first", bench.now)
    plan = bench.steering.plan
    sent = bench.run(0.03)
    assert bench.steering.obstacle(bench.now) is Obstacle.RELEASING
    bench.steering.release("second", bench.now)
    assert bench.steering.plan is plan
    sent += bench.run(0.5, answers=True)
    assert {entry.purpose for _, entry, _ in sent} == {Purpose.RELEASE}
    bench.steering.release("third", bench.now)
    assert bench.steering.plan is not plan


def test_leaving_lets_nothing_follow_the_release():
    bench = Bench()
    bench.poll_telemetry()
    bench.steering.leave(bench.now)
    after = bench.run(5.0, answers=True)
    assert [entry.purpose for _, entry, _ in after] == [Purpose.RELEASE] * REPEATS


def test_a_release_passed_on_by_a_navictrl_is_spaced_as_it_can_pass_it_on():
    """Closer than 25 ms half of the frames vanish on their way: five would not be five."""
    bench = Bench(direct=Board.NC)
    bench.scheduler.rules = LineRules(direct=Board.NC, setpoint_interval=FORWARDING_GAP)
    bench.steer()
    bench.run(0.005)
    bench.steering.release("test", bench.now)
    bench.run(1.0)
    assert [entry.purpose for _, entry, _ in bench.sent] == [Purpose.SETPOINT] + [Purpose.RELEASE] * (1 + REPEATS)
    assert [message.config for *_, message in bench.sent] == [1, 1] + [0] * REPEATS
    gaps = [later - at for (at, *_), (later, *_) in itertools.pairwise(bench.sent)]
    assert min(gaps) >= FORWARDING_GAP - 1e-9
    assert max(gaps) <= FORWARDING_GAP + 0.003
    assert bench.steering.plan is not None
    assert bench.steering.plan.outcome is ReleaseOutcome.NOT_OBSERVABLE


@pytest.mark.parametrize(("version", "is_held"), [(VERSION_2_08, False), (VERSION_EARLY, True)])
def test_after_an_unobservable_release_nothing_passed_on_keeps_the_sticks_of_the_oldest_alive(version, is_held):
    bench = Bench(direct=Board.NC)
    bench.peers.learn(Board.FC, version)
    bench.steering.release("test", bench.now)
    bench.run(0.2)
    assert bench.scheduler.holds_back("y", bench.now) is is_held
    assert not bench.scheduler.holds_back("b", bench.now)
    bench.steer()  # a new client may fly at once
    bench.run(QUIET_TIME)
    assert not bench.scheduler.holds_back("y", bench.now)
