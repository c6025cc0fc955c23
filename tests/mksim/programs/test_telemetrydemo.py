"""The demo of the telemetry, end to end: what is shown, and what its exit code means."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path

import pytest
from rich.console import Console

from lab.rigs.programs import mkdaemon, run_mkdaemon
from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import run
from mkdaemon.client import Sample
from mksim.programs.telemetrydemo import ENOUGH, DemoTally, progress_line, render_summary, summarise
from tests.reading.knownflight import KNOWN


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


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf"])
def test_what_is_no_length_of_time_starts_nothing(seconds, capsys):
    assert run(app, ["demo", "--telemetry", "--seconds", seconds]) == 2
    assert capsys.readouterr() == ("", f"mkdaemon: --seconds {seconds}: give a number above 0\n")


@pytest.mark.flight
@pytest.mark.real_time(tolerance=0.1)
@pytest.mark.parametrize(
    ("stage", "number"), [("starting the simulated", signal.SIGINT), ("aircraft on", signal.SIGTERM)]
)
def test_a_signal_while_it_starts_ends_it(stage, number):
    with mkdaemon("demo", "--telemetry", "--seconds", "100") as program:
        wait_for_line(program, stage)
        program.send_signal(number)
        out, err = program.communicate()
        # A daemon that was quick enough to let telemetry flow makes it an ordinary end.
        assert program.returncode == (0 if "telemetry flowed" in out else 1 if "NOT flow" in out else 130), out + err
        assert own_words(err) == []


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


def test_the_summary_in_words():
    tally = DemoTally()
    tally.take(Sample("rx/nc/osd", {}, ""), 0.0)
    tally.take(Sample("rx/nc/osd", {}, ""), 2.0)
    assert "NOT flow: nothing on " in in_words(tally)
    tally.known |= {suffix: {} for suffix in ENOUGH}
    tally.known["state/battery"] = {"voltage": 12.4, "current": None, "used_mah": None, "cells": None, "is_low": False}
    tally.known["state/position"] = {
        "latitude_deg": 53.2301,
        "longitude_deg": 7.4591,
        "altitude_above_start": 1.9,
        "position_enu": (0.0, 0.0, 1.9),
        "home_distance": 0.0,
        "velocity_enu": (0.0, 0.0, 0.0),
        "satellites": 9,
    }
    out = in_words(tally)
    assert "2.0 s: telemetry flowed" in out
    assert re.search(r"rx/nc/osd\W+2\W+1\.0", out)
    tally.reading.take("state/battery", KNOWN["state/battery"], 2.0)
    assert "15.2 V, 11.5 A, 812 mAh" in in_words(tally)
    assert progress_line(tally) == "2 s; 2 frames; 12.4 V; 53.230100, 7.459100; 1.9 m above start"


def in_words(tally):
    """What the summary looks like."""
    console = Console(width=120)
    with console.capture() as written:
        console.print(render_summary(tally, summarise(tally)))
    return written.get()


def test_telemetry_has_flowed_only_when_all_of_it_has():
    tally = DemoTally()
    for n, suffix in enumerate(ENOUGH):
        assert not tally.has_flowed
        assert not summarise(tally)["telemetry_flowed"]
        tally.take(Sample(suffix, {}, ""), float(n))
    assert tally.has_flowed
    tally.take(Sample("rx/nc/osd", {}, ""), 10.0)
    tally.take(Sample("rx/nc/osd", {}, ""), 10.0)
    assert summarise(tally)["rates_hz"] == {"rx/nc/osd": 0.2}
