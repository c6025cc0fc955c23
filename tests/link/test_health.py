"""Health: what evidence shows over time, and nothing claimed without proof; each fault as such in test_link_truth."""

from __future__ import annotations

import pytest

from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.verdict import QUIET, STOPPED, HeldFinding, VerdictCause, VerdictFinding
from mkdaemon.protocol.framing import DropReason
from mkdaemon.telemetry.link import LinkCondition

STREAMS = {"osd": 0.1, "attitude": 0.05}


class Line:
    """A line in steps of 5 ms: streams on time, probes at 5 Hz (10 Hz while one is unanswered), answered after 4 ms."""

    def __init__(self, *, probes: bool = True, streams: dict[str, float] | None = None, **options: float) -> None:
        self.health = HealthMonitor(**options)
        self.now = 100.0
        self.streams = STREAMS if streams is None else streams
        self.probes = probes
        self.talks = self.listens = True
        self.lose_every = 0
        self._probe = 0
        self._last_probe = 0.0
        self.health.port_opened(self.now)
        self.health.wanted("nc", self.streams, self.now)
        self._due = dict.fromkeys(self.streams, self.now)

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            self.step()

    def until(self, condition: LinkCondition, within: float) -> float:
        began = self.now
        while self.health.verdict.condition is not condition:
            assert self.now - began < within, self.health.verdict
            self.step()
        return self.now - began

    def step(self) -> None:
        self.now += 0.005
        now, health = self.now, self.health
        for key, interval in self.streams.items():
            if now >= self._due[key]:
                self._due[key] += interval
                if self.talks:
                    health.frame_received("nc", key, 100, now)
        rate = 0.101 if health.awaits_answer else 0.2
        if self.probes and now - self._last_probe >= rate:
            self._probe += 1
            self._last_probe = now
            health.probe_sent(self._probe, now)
            lost = self.lose_every and self._probe % self.lose_every == 0
            if self.listens and self.talks and not lost:
                health.frame_received("nc", "echo", 10, now + 0.004)
                health.probe_answered(self._probe, now + 0.004)
        health.port_backlog(0, now)
        health.judge(now)


def up(**options: object) -> Line:
    line = Line(**options)  # type: ignore[arg-type]
    line.until(LinkCondition.UP, 0.5)
    line.run(1.0)
    assert line.health.verdict.condition is LinkCondition.UP
    return line


@pytest.fixture
def line():
    return up()


SEARCHING = VerdictFinding(LinkCondition.GARBAGE, "no frame at 9600 baud: trying 57600")


@pytest.mark.parametrize(
    ("opened", "happens", "condition", "words"),
    [
        ({}, lambda health: None, LinkCondition.DOWN, "nothing received yet"),
        ({}, lambda health: health.question_sent(1.0), LinkCondition.MUTE, "nothing arrives"),
        ({"searching": SEARCHING}, lambda health: None, LinkCondition.GARBAGE, "trying 57600"),
        (
            {"is_recording": True},
            lambda health: health.frame_received("nc", "osd", 118, 1.1),
            LinkCondition.UP,
            "a recording plays",
        ),
    ],
    ids=["nothing yet", "asked in vain", "a search", "a recording"],
)
def test_a_port_that_was_just_opened_claims_no_more_than_it_can(opened, happens, condition, words):
    health = HealthMonitor()
    health.port_opened(1.0, **opened)
    happens(health)
    health.judge(1.05 if condition is LinkCondition.DOWN else 1.4)
    assert health.verdict.condition is condition
    assert words in health.verdict.reason


def test_one_way_does_not_flap_with_slow_streams_and_ends_in_mute():
    line = up(streams={"osd": 1.0})
    line.listens = False
    line.run(1.5)
    seen = set()
    for _ in range(600):
        line.step()
        seen.add(line.health.verdict.condition)
    assert seen <= {LinkCondition.ONE_WAY, LinkCondition.MUTE}
    line.talks = False
    line.run(4.0)
    assert line.health.verdict.condition is LinkCondition.MUTE


def test_bytes_waiting_inside_the_port_keep_the_verdict(line):
    line.run(0.1)
    health, now = line.health, line.now + 1.0
    health.probe_sent("a", now)
    health.probe_sent("b", now + 0.1)
    health.frame_received("nc", "osd", 100, now + 0.29)
    health.frame_received("nc", "attitude", 26, now + 0.29)
    health.port_backlog(5, now + 0.29)
    health.judge(now + 0.3)
    assert health.verdict.condition is LinkCondition.UP


@pytest.mark.parametrize("cut", [True, False], ids=["a frame cut short by silence", "a glitch"])
def test_a_little_damage_before_a_silence_is_no_garbage(line, cut):
    line.talks = False
    if cut:
        line.health.bytes_received(60, line.now + 0.02)
    else:
        line.health.damaged(DropReason.LENGTH, b"#", line.now)
    line.until(LinkCondition.MUTE, 0.5)


def test_losses_above_the_limit_degrade_with_the_figure():
    line = up(max_loss_percent=5.0)
    line.lose_every = 5
    line.until(LinkCondition.DEGRADED, 5.0)
    assert "% of link tests lost in 10 s" in line.health.verdict.reason
    line.lose_every = 0
    line.run(11.0)
    assert line.health.verdict.condition is LinkCondition.UP


def test_damaged_bytes_degrade(line):
    for _ in range(30):
        line.health.damaged(DropReason.CHECKSUM, bytes(50), line.now)
        line.step()
    line.run(0.05)
    assert line.health.verdict.condition is LinkCondition.DEGRADED
    assert "damaged" in line.health.verdict.reason
    garbage, checksums = line.health.damage_rates(line.now)
    assert garbage == pytest.approx(150)
    assert checksums == pytest.approx(3)


def test_unanswered_beside_damage_is_called_damage(line):
    line.listens = False
    for _ in range(100):
        line.health.damaged(DropReason.CHECKSUM, bytes(10), line.now)
        line.step()
    assert line.health.verdict.condition is LinkCondition.DEGRADED
    assert line.health.verdict.reason == "frames arrive damaged, and nothing we send is answered"


def test_an_outage_is_counted_and_says_nothing_about_the_line_afterwards(line):
    line.talks = False
    line.until(LinkCondition.MUTE, 0.5)
    line.run(2.0)
    line.talks = True
    line.until(LinkCondition.UP, 0.5)
    line.run(1.0)
    assert line.health.verdict.condition is LinkCondition.UP
    assert line.health.echo.losses(line.now)[1] == 0
    fates = line.health.echo.tally.fates()
    assert fates.outage > 0
    assert fates.unanswered == line.health.echo.statistics(line.now).lost


def test_a_lost_port_is_down_or_absent_at_once(line):
    line.health.port_lost(line.now, "unplugged")
    assert line.health.verdict.condition is LinkCondition.DOWN
    since = line.health.verdict.since
    line.health.port_lost(line.now + 1, "still unplugged")
    assert line.health.verdict.reason == "still unplugged"
    assert line.health.verdict.since == since
    line.health.port_lost(line.now + 2, "no such device", LinkCondition.ABSENT)
    assert line.health.verdict.condition is LinkCondition.ABSENT
    assert not line.health.judge(line.now + 3)


def test_our_own_pause_is_nobodys_fault(line):
    line.talks = False
    line.health.pause(line.now + 1.33)
    line.health.pause(line.now + 0.5)
    line.run(1.3)
    assert line.health.verdict.condition is LinkCondition.UP
    line.until(LinkCondition.MUTE, 0.5)


def test_an_answer_that_comes_late_shows_all_the_same_that_the_board_hears_us(line):
    line.probes = False
    waiting: list[tuple[float, int]] = []
    for token in range(1, 60):
        line.health.probe_sent(token, line.now)
        waiting.append((line.now + 0.32, token))
        for _ in range(20):
            line.step()
            while waiting and waiting[0][0] <= line.now:
                line.health.probe_answered(waiting.pop(0)[1], line.now)
        # until the first one nothing told a slow board from a deaf one
        assert line.health.verdict.condition.is_usable or token < 5, line.health.verdict
    line.health.probe_answered(9999, line.now)  # nobody asked: proves nothing
    answered = line.health.answer_age(line.now)
    line.run(2.0)
    line.health.probe_answered(59, line.now)  # asked too long ago
    assert line.health.answer_age(line.now) == pytest.approx(answered + 2.0, abs=0.02)


def test_what_was_asked_while_the_board_said_nothing_is_no_sign_of_a_cut_wire():
    line = up(streams={"osd": 0.05})
    for _ in range(8):
        line.talks = False
        line.run(0.32)  # it stands still, and is back before that is a silence
        line.talks, line.listens = True, False
        line.run(0.06)  # what it sends on its own comes first
        assert line.health.verdict.condition is not LinkCondition.ONE_WAY
        line.listens = True
        line.run(0.6)
    line.listens = False
    line.until(LinkCondition.ONE_WAY, 0.5)


def test_a_line_that_comes_and_goes_is_one_verdict_until_it_stays(line):
    said = set()
    for _ in range(5):
        line.talks = False
        line.until(LinkCondition.MUTE, 0.5)
        line.talks = True
        line.run(0.8)
        said.add((line.health.verdict.condition, line.health.verdict.reason.partition(" times")[0]))
    assert (LinkCondition.DEGRADED, "it was lost 5") in said
    assert sum(condition is LinkCondition.UP for condition, _ in said) == 1  # after the first one
    line.until(LinkCondition.UP, 11.0)


@pytest.mark.parametrize("interval", [0.02, 0.1, 0.2, 0.3])
def test_a_line_deaf_from_the_start_is_never_up(interval: float):
    line = Line(streams={"debug": interval})
    line.listens = False
    seen = set()
    for _ in range(1000):
        line.step()
        seen.add(line.health.verdict.condition)
    assert seen == {LinkCondition.DOWN, LinkCondition.ONE_WAY}


@pytest.mark.parametrize("interval", [0.4, 0.5, 1.0, 2.5])
def test_a_slow_stream_alone_is_not_mute_between_two_frames(interval: float):
    line = up(streams={"debug": interval})
    line.probes = False
    for _ in range(2000):
        line.step()
        assert line.health.verdict.condition is LinkCondition.UP
    line.talks = False
    line.until(LinkCondition.MUTE, 4 * interval)


def test_silence_we_keep_ourselves_is_told_as_that():
    line = up()
    line.talks = False
    line.health.keep_quiet(line.now + 2.0)
    line.until(LinkCondition.MUTE, 0.5)
    assert line.health.verdict.reason == QUIET
    line.run(2.0)
    assert line.health.verdict.reason == STOPPED


def test_a_silence_begins_when_the_board_was_heard_last_and_goes_on_under_another_name():
    up = VerdictFinding(LinkCondition.UP, "both directions proven")
    mute, garbage = VerdictFinding(LinkCondition.MUTE, "nothing"), VerdictFinding(LinkCondition.GARBAGE, "no frame")
    stuck = VerdictFinding(LinkCondition.DOWN, "stuck", VerdictCause.PORT_STUCK)
    verdict = HeldFinding(up, 1.0).followed_by(mute, 2.0, 1.6)
    assert (verdict.since, verdict.silent_since) == (2.0, 1.6)
    verdict = verdict.followed_by(garbage, 3.0, 1.6).followed_by(stuck, 4.0, 4.0)
    assert (verdict.since, verdict.silent_since, verdict.is_outage) == (4.0, 1.6, True)
    assert verdict.followed_by(up, 5.0, 5.0).silent_since > 1e9
