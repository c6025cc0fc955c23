"""The signal that troubles a daemon, and the guard that is quiet."""

from __future__ import annotations

import signal

from lab.cases import silence_log
from lab.rigs.cockpit import Boards
from lab.rigs.troubled import TROUBLE
from lab.stories import quiet
from mkdaemon.cli.mkdaemon.run import RELOAD


def test_the_signal_of_the_lab_is_none_that_the_daemon_takes_for_itself():
    assert TROUBLE not in {RELOAD, signal.SIGINT, signal.SIGTERM}


def test_the_guard_is_quiet_in_a_flight_with_faults(monkeypatch):
    silence_log()
    monkeypatch.setattr(quiet, "FLIGHT", 8.0)
    found = quiet.fly_quietly(Boards("2.08"), 1)
    assert not found["is_wrong"]
    assert found["leases"] >= 1
    assert found["hours"] > 0.001
