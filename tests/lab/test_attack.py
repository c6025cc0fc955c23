"""What the campaign of attacks makes of its runs, and the guard that is quiet."""

from __future__ import annotations

import signal
from dataclasses import replace

import pytest

from lab.attack import flightlog, quiet
from lab.attack.blocked import Blocked
from lab.attack.deaths import Attack
from lab.attack.flightlog import FlightLog, Gaps
from lab.attack.floods import Ride
from lab.attack.guardless import GuardDeath
from lab.attack.programs import HELD_DAEMON
from lab.attack.virtual import Silence, fly_virtually
from lab.cases import silence_log
from lab.rigs.cockpit import Boards
from lab.rigs.processes import Sticks
from lab.rigs.troubled import TROUBLE
from mkdaemon.cli.mkdaemon.run import RELOAD
from mkdaemon.client import Sample
from mkdaemon.protocol.framing import encode_frame

RIDE = Ride(("1000", "1000"), 0.02, 0.03, 0.04, True, None, 0.1, 100.0, 90.0, 1.0)


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
    found = Ride(**{field: getattr(RIDE, field) for field in Ride.__slots__} | changed)
    assert found.is_wrong is is_wrong


def test_a_guard_whose_death_is_not_said_is_wrong():
    assert not GuardDeath(0.1, "guard_dead", True).is_wrong
    assert GuardDeath(0.1, None, True).is_wrong


def test_a_flight_that_is_slow_beside_a_late_machine_is_wrong_and_says_so():
    slow = Attack("FC 2.08", "killed", "pty", 0.36, 0.5, 0, late=0.05)
    lost = replace(slow, neutral=0.3, blocked=Blocked(kept=False, gaps=Gaps(0.3, 0.3, 0.3, 0.3)))
    assert [one.is_machine_late for one in (slow, replace(slow, late=0.005), lost)] == [True, False, False]
    assert slow.is_wrong
    assert lost.is_wrong


class Putter:
    def __init__(self):
        self.puts = []


class Listening:
    """Boards that heard stick frames."""

    def __init__(self):
        self.heard, self.sticks = [], Sticks.STEERED


def test_a_log_of_a_flight_tells_where_setpoints_were_late(monkeypatch):
    now = 100.0
    monkeypatch.setattr(flightlog.time, "monotonic", lambda: now)
    pilot, boards = Putter(), Listening()
    log = FlightLog(pilot, boards)
    pilot.puts += [100.1, 100.2, 100.3]
    for at in (100.1, 100.35):
        log.note(Sample("control/output", {"stamp": {"monotonic": at}, "age": 0.01}, ""))
    stick = encode_frame(1, "b", bytes([1, 0, 0, 0, 0, 1, 0]))
    boards.heard += [(100.15, stick[:4]), (100.2, stick[4:]), (100.3, encode_frame(1, "b", bytes(7)))]
    now = 100.4
    assert log.gaps() == Gaps(put=0.1, received=0.25, sent=0.25, heard=0.2)


def test_a_log_of_a_flight_tells_when_control_was_lost(monkeypatch):
    now = 100.0
    monkeypatch.setattr(flightlog.time, "monotonic", lambda: now)
    boards = Listening()
    log = FlightLog(Putter(), boards)
    assert log.look_at_boards()
    now, boards.sticks = 100.5, Sticks.NOTHING
    log.note(Sample("event/failsafe", {"stamp": {}, "action": "release", "reason": "setpoints ended"}, ""))
    assert not log.look_at_boards()
    assert not log.look_at_boards()
    assert log.said == [
        "0.500 event/failsafe {'action': 'release', 'reason': 'setpoints ended'}",
        "0.500 the boards hold nothing",
    ]


@pytest.mark.parametrize(("silence", "limit"), [(Silence.CLOSED, 0.1), (Silence.AGED, 0.9)])
async def test_the_guard_releases_in_virtual_time_too(silence, limit):
    found = await fly_virtually(Boards("2.08"), silence, 1)
    assert found.released <= limit
    assert not found.is_wrong


def test_the_guard_is_quiet_in_a_flight_with_faults(monkeypatch):
    silence_log()
    monkeypatch.setattr(quiet, "FLIGHT", 8.0)
    found = quiet.fly_quietly(Boards("2.08"), 1)
    assert not found.is_wrong
    assert found.leases >= 1
    assert found.hours > 0.001
