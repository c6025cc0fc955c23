"""Health claims nothing it has no proof of, and misses nothing before its time."""

from __future__ import annotations

import pytest

from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.verdict import QUIET, STOPPED
from mkdaemon.telemetry.link import LinkCondition
from tests.link.test_health import Line, up


@pytest.mark.parametrize("interval", [0.02, 0.1, 0.2, 0.3])
def test_a_line_deaf_from_the_start_is_never_up(interval: float):
    line = Line(streams={"debug": interval})
    line.listens = False
    seen = set()
    for _ in range(1000):
        line.step()
        seen.add(line.health.verdict.condition)
    assert seen == {LinkCondition.DOWN, LinkCondition.ONE_WAY}


def test_a_board_that_talks_unasked_proves_only_one_direction():
    health = HealthMonitor()
    health.port_opened(1.0)
    for step in range(20):
        health.frame_received("fc", "debug", 94, 1.0 + step / 10)
        health.judge(1.01 + step / 10)
    assert health.verdict.condition is LinkCondition.DOWN
    health.board_answered(3.0)
    health.judge(3.01)
    assert health.verdict.condition is LinkCondition.UP


@pytest.mark.parametrize("interval", [0.4, 0.5, 1.0, 2.5])
def test_a_slow_stream_alone_is_not_mute_between_two_frames(interval: float):
    line = up(streams={"debug": interval})
    line.probes = False
    for _ in range(2000):
        line.step()
        assert line.health.verdict.condition is LinkCondition.UP
    line.talks = False
    line.until(LinkCondition.MUTE, 4 * interval)


def test_one_lost_link_test_is_not_silence():
    line = up(streams={})
    line.lose_every = 7
    line.run(5.0)
    for _ in range(1000):
        line.step()
        assert line.health.verdict.condition is not LinkCondition.MUTE


def test_silence_we_keep_ourselves_is_told_as_that():
    line = up()
    line.talks = False
    line.health.keep_quiet(line.now + 2.0)
    line.until(LinkCondition.MUTE, 0.5)
    assert line.health.verdict.reason == QUIET
    line.run(2.0)
    assert line.health.verdict.reason == STOPPED
