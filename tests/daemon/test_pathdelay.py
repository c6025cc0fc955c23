"""Nobody flies over a path that is slower than the ladder allows."""

from __future__ import annotations

import pytest

from mkdaemon.daemon.pathdelay import WAITING, PathProbe
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.refusals import Token


class Time:
    """A clock that is set."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Time()


@pytest.fixture
def probe(clock):
    return PathProbe(0.5, clock)


def test_an_echo_that_is_back_in_time_counts_once(probe, clock):
    echo = probe.new_echo()
    clock.now += 0.49
    probe.check(echo)
    with pytest.raises(CommandRejectedError, match="unknown"):
        probe.check(echo)


def test_an_echo_that_comes_late_says_how_late(probe, clock):
    echo = probe.new_echo()
    clock.now += 2.05
    with pytest.raises(CommandRejectedError, match=r"takes 2\.05 s, more than 0\.5 s") as refused:
        probe.check(echo)
    assert refused.value.token == Token.SLOW_PATH
    assert "max_path_delay" in refused.value.fix


def test_who_asks_for_no_echo_is_not_measured(probe):
    probe.check("")


def test_echoes_that_never_come_back_fill_no_memory(probe):
    first = probe.new_echo()
    last = [probe.new_echo() for _ in range(WAITING)][-1]
    probe.check(last)
    with pytest.raises(CommandRejectedError):
        probe.check(first)
