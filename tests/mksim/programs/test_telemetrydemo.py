"""The demo of the telemetry, end to end: what is shown, and what its exit code means."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from lab.rigs.programs import mkdaemon, run_mkdaemon


@pytest.mark.flight
@pytest.mark.real_time(tolerance=0.1)
def test_the_demo_flies_and_ends_with_a_summary():
    code, out, err = run_mkdaemon("demo", "--telemetry", "--seconds", "2", "--json")
    summary = json.loads(out.splitlines()[-1])
    assert code == 0, err
    assert summary["telemetry_flowed"] is True
    assert summary["frames"]["rx/nc/osd"] >= 1
    assert summary["rates_hz"]["rx/nc/attitude"] > 0
    echo = summary["echo_ms"]["p50"]  # None where a loaded machine let no link test be answered yet
    assert echo is None or echo > 3.4  # two frames of ten characters at 57600 baud
    assert 10 < summary["battery_v"] < 18
    assert -90 < summary["latitude_deg"] < 90


@pytest.mark.flight
@pytest.mark.real_time(tolerance=0.1)
def test_a_daemon_that_dies_is_noticed():
    with mkdaemon("demo", "--telemetry", "--seconds", "100") as program:
        wait_for_line(program, "frames")
        victim = [pid for pid in children_of(program.pid) if "run" in arguments_of(pid)]
        os.kill(*victim, signal.SIGKILL)
        _, err = program.communicate()
        assert program.returncode == 1
        assert own_words(err) == ["mkdaemon: the daemon ended while it flew: exit code -9"]


def wait_for_line(program, words):
    """Read what a program prints until a line has the words; one that ends before fails with what it said."""
    if not any(words in line for line in program.stdout):
        pytest.fail(f"it ended with {program.wait()} before {words!r}: {program.stderr.read()}")


def own_words(err):
    """What the demo said; asyncio notes a child that was asked to end twice and whose exit code came in between."""
    return [line for line in err.splitlines() if not line.startswith("Unknown child process")]


def children_of(pid):
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def arguments_of(pid):
    return Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
