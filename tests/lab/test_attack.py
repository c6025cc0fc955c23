"""What the campaign of attacks makes of its runs, and the guard that is quiet."""

from __future__ import annotations

import signal

import pytest

from lab.attack import deaths, quiet
from lab.attack.floods import breaks_limit
from lab.attack.programs import HELD_DAEMON, TROUBLE
from lab.cases import silence_log
from lab.rigs.cockpit import Boards
from mkdaemon.cli.mkdaemon.run import RELOAD

RIDE = {"gap_p99": 0.03, "kept": True, "neutral": None, "released": 0.1, "memory_mb": 100.0, "log": 90.0}


def test_what_the_lab_tells_a_daemon_by_is_no_signal_that_the_daemon_takes_for_itself():
    assert TROUBLE not in {RELOAD, signal.SIGINT, signal.SIGTERM}
    compile(HELD_DAEMON, "held", "exec")
    assert f"signal.signal({int(TROUBLE)}," in HELD_DAEMON


@pytest.mark.parametrize(
    ("changed", "is_wrong"),
    [
        ({}, False),
        ({"gap_p99": 0.07}, True),
        ({"kept": False}, True),
        ({"released": 3.0}, True),
        ({"released": 1.11}, False),
        ({"neutral": 0.35, "released": 1.1}, False),
        ({"neutral": 0.35, "released": 1.11}, True),
        ({"neutral": 0.36, "released": 1.1}, True),
        ({"memory_mb": 151.0}, True),
        ({"log": 11_000.0}, True),
    ],
)
def test_a_ride_is_wrong_where_one_limit_is_broken(changed, is_wrong):
    assert breaks_limit(RIDE | changed) is is_wrong


def test_a_guard_whose_death_is_not_said_or_costs_the_flight_is_wrong():
    found = [(0.1, "guard_dead", True), (0.1, None, True), (0.6, "guard_dead", True), (0.1, "guard_dead", False)]
    judged = [deaths.judged_guard(noticed, token, is_kept=kept)["is_wrong"] for noticed, token, kept in found]
    assert judged == [False, True, True, True]


def test_a_death_is_wrong_where_one_limit_is_broken():
    found = [
        (0.35, 1.1, 0, True),
        (0.36, 0.5, 0, True),
        (0.3, 1.11, 0, True),
        (0.3, 1.0, 1, True),
        (0.3, 1.0, 0, False),
    ]
    assert [deaths.judged(*one, is_kept=kept)["is_wrong"] for *one, kept in found] == [False, True, True, True, True]


def test_the_guard_is_quiet_in_a_flight_with_faults(monkeypatch):
    silence_log()
    monkeypatch.setattr(quiet, "FLIGHT", 8.0)
    found = quiet.fly_quietly(Boards("2.08"), 1)
    assert not found["is_wrong"]
    assert found["leases"] >= 1
    assert found["hours"] > 0.001
