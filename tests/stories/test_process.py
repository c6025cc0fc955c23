"""A daemon process that is killed while a client flies, and the rules by which real-time stories are judged."""

from __future__ import annotations

import signal
from dataclasses import replace

import pytest

from lab.rigs.pilot import NotObeyedError
from lab.stories.kill import End, end_daemon
from lab.stories.plug import Replugs
from lab.stories.race import Grant, Race, may_steer
from lab.stories.soak import Soak
from tests.repeats import InconclusiveError


@pytest.mark.real_time(tolerance=0.1)
async def test_after_a_kill_the_next_start_begins_with_a_release_and_nobody_steers():
    try:
        end = await end_daemon("2.08", signal.SIGKILL, seed=1)
    except NotObeyedError as why:
        raise InconclusiveError(str(why)) from why
    assert (end.exit_code, end.first, end.steered, end.tracebacks) == (-signal.SIGKILL, "release", 0, 0), end


def test_an_orderly_end_is_late_after_two_seconds():
    good = End("2.08", "SIGTERM", 0.5, 0.1, "release", 0, None, 0, 0)
    assert not good.is_wrong
    assert replace(good, signal="SIGKILL", held=5.0, exit_code=-9).is_wrong is False
    for change in ({"took": 2.1}, {"held": 2.1}, {"exit_code": 1}, {"first": "nothing"}, {"tracebacks": 1}):
        assert replace(good, **change).is_wrong, change


def test_who_may_steer():
    grants = [Grant(1.0, 1.1, "forward"), Grant(5.0, 5.2, "back")]
    assert [may_steer(grants, at, 1) for at in (0.5, 1.05, 2.0, 5.1, 5.3)] == [False, True, True, True, False]
    assert [may_steer(grants, at, -1) for at in (2.0, 5.1, 5.3)] == [False, True, True]
    assert Race(takes=3, refused=0, frames=9, tilted=5, foreign=1, backwards=0, unseen=0).is_wrong
    assert Race(takes=3, refused=0, frames=9, tilted=0, foreign=0, backwards=0, unseen=0).is_wrong
    assert not Race(takes=3, refused=0, frames=9, tilted=5, foreign=0, backwards=0, unseen=0).is_wrong


def test_a_leak_or_a_lost_frame_fails_the_long_runs():
    flat = Replugs(200, 0.2, 0.9, [], [], (30, 30), (80.0, 80.1), 0)
    assert not flat.is_wrong
    for change in ({"descriptors": (30, 31)}, {"memory_mb": (80.0, 83.0)}, {"not_release": [4]}, {"back_max": 3.1}):
        assert replace(flat, **change).is_wrong, change
    good = Soak(1200.0, 10, 10, 20, 20, {"expired": 3}, 0, (80.0, 80.5), (30, 30), 9.0, 0.0, 0)
    assert not good.is_wrong
    for change in ({"daemon_received": 9}, {"dropped": {"checksum": 1}}, {"tracebacks": 1}, {"cpu_percent": 26.0}):
        assert replace(good, **change).is_wrong, change
