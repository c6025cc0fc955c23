"""Nobody flies over a path that is slower than the ladder allows."""

from __future__ import annotations

import math

import pytest

from mkdaemon.control.admission.beginnings import TakeLease
from mkdaemon.control.admission.rows import refusal
from mkdaemon.daemon.pathdelay import WAITING, PathProbe
from mkdaemon.telemetry.refusals import Token
from tests.control.admission.situations import GOOD


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
    return PathProbe(clock)


def test_an_echo_that_is_back_in_time_counts_once(probe, clock):
    echo = probe.new_echo()
    clock.now += 0.49
    assert probe.delay(echo) == pytest.approx(0.49)
    assert probe.delay(echo) == math.inf


def test_an_echo_that_comes_late_says_how_late(probe, clock):
    echo = probe.new_echo()
    clock.now += 2.05
    error = refusal(TakeLease(path_delay=probe.delay(echo), is_early=True), GOOD)
    assert error.token == Token.SLOW_PATH
    assert "takes 2.05 s, more than 0.5 s" in error.reason
    assert "max_path_delay" in error.fix


def test_who_asks_for_no_echo_is_not_measured(probe):
    assert probe.delay("") is None


def test_echoes_that_never_come_back_fill_no_memory(probe):
    first = probe.new_echo()
    last = [probe.new_echo() for _ in range(WAITING)][-1]
    assert probe.delay(last) == 0.0
    assert probe.delay(first) == math.inf
