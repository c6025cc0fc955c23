"""The programs of docs/library.md run as they stand there."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import sys
from contextlib import asynccontextmanager

import pytest

from lab.places import ROOT
from lab.rigs.live import VEHICLE, live_daemon
from lab.rigs.overtarget import VEHICLE as FLOWN
from lab.rigs.overtarget import Setting, hovering
from lab.rigs.waiting import wait_for
from mksim.config import PilotPlan

PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
CORNERS = (("middle", 0.0, 0.0), ("east", 0.4, 0.0), ("north", 0.4, 0.4), ("west", 0.0, 0.4), ("south", 0.0, 0.0))
"""Of the square over the target [m]."""
PATIENCE = 120.0
"""Longest time for a program [s]; a loaded machine is slow, not wrong."""


def program(heading):
    """The block of Python under a heading."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    return re.search(r"```python\n(.*?)```", section, re.DOTALL)[1]


@asynccontextmanager
async def running(heading, **options):
    """A program of the page as a process of its own."""
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-u", "-c", program(heading), stdout=pipe, stderr=pipe, **options
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def output_of(heading, **options):
    """What a program printed; it must end well."""
    async with asyncio.timeout(PATIENCE), running(heading, **options) as process:
        out, err = await process.communicate()
        assert (process.returncode, err.decode()) == (0, "")
        return out.decode().splitlines()


def environment(flown):
    return os.environ | {"MK_CONNECT": flown.endpoint, "MK_VEHICLE": VEHICLE}


@pytest.mark.parametrize(
    ("heading", "lines"),
    [("Decode a capture", 10), ("Watch the attitude", 10), ("Fly a square", 15), ("Fly by sticks", 15)],
)
def test_the_programs_are_short(heading, lines):
    assert sum(bool(line.strip()) for line in program(heading).splitlines()) <= lines


async def test_a_capture_decodes_without_a_daemon(tmp_path):
    shutil.copy(ROOT / "tests/data/captures/nc_mixed_60s.jsonl", tmp_path / "flight.jsonl")
    lines = await output_of("Decode a capture", cwd=tmp_path)
    assert lines[0] == "  0.00 s  16.4 V, 9 satellites"
    assert "('OsdData5', 31)" in lines[-1]


@pytest.mark.flight
async def test_the_attitude_is_watched():
    async with (
        live_daemon(board="nc") as flown,
        asyncio.timeout(PATIENCE),
        running("Watch the attitude", env=environment(flown)) as process,
    ):
        for _ in range(5):
            line = (await process.stdout.readline()).decode()
            assert re.fullmatch(r"roll [+-]\d+\.\d, pitch [+-]\d+\.\d, from nc/attitude\n", line), line


@pytest.mark.flight
async def test_the_questions_are_answered():
    async with live_daemon() as flown:
        await flown.until(
            lambda: flown.values("state/battery") and any(value["is_alive"] for value in flown.values("health"))
        )
        lines = await output_of("Ask", env=environment(flown))
        assert lines[0].startswith("alive: True battery: ")
        assert lines[1].startswith("streams: {'attitude': ")
        assert lines[2] == "active parameter set: 3"
        assert lines[3].startswith("no_such_stream ")


@pytest.mark.flight
async def test_a_backup_is_written(tmp_path):
    async with live_daemon() as flown:
        await flown.until(lambda: flown.values("state/flight") or flown.values("health"))
        lines = await output_of("Procedures", env=environment(flown), cwd=tmp_path)
        assert len(lines) > 3
        assert lines[-1].startswith("saved: ")
        assert sorted(lines[-1].removeprefix("saved: ").split(", ")) == sorted(
            file.name for file in (tmp_path / "backup").iterdir()
        )


@pytest.mark.flight
@pytest.mark.real_time(tolerance=0.1)
async def test_a_square_is_flown_by_positions_over_a_target():
    async with hovering(Setting(fps=10.0)) as hover:
        found = os.environ | {"MK_CONNECT": hover.endpoint, "MK_VEHICLE": FLOWN}
        lines = await output_of("Fly a square", env=found)
        await wait_for(lambda: hover.seen.phases[-1].startswith("free"), PATIENCE)
    assert [words.partition(":")[0] for words in hover.seen.phases] == ["free", "leased", "flying", "releasing", "free"]
    assert hover.seen.failsafes == []
    for line, (name, x, y) in zip(lines, CORNERS, strict=True):
        east, north, up = map(float, re.findall(r"-?\d+\.\d+(?:e-\d+)?", line))
        assert line.split()[0] == name
        assert abs(east - x) < 0.3, line
        assert abs(north - y) < 0.3, line
        assert abs(up - 2.0) < 0.3, line


@pytest.mark.flight
@pytest.mark.real_time(tolerance=0.1)
async def test_a_square_is_flown_by_sticks_in_the_simulator():
    async with live_daemon(board="nc", pilot_plan=PilotPlan.SUPERVISE, pilot_wait=PATIENCE) as flown:
        flown.runtime.simulation.start_pilot()
        await wait_for(lambda: hovers(flown), PATIENCE)
        lines = await output_of("Fly by sticks", env=environment(flown))
        assert [line.split()[0] for line in lines] == ["north", "east", "south", "west"]
        corners = [tuple(map(float, re.findall(r"-?\d+\.\d+", line)[:2])) for line in lines]
        assert corners[1][0] - corners[0][0] > 0.3, "east"
        assert corners[1][1] - corners[2][1] > 0.3, "south"
        assert corners[2][0] - corners[3][0] > 0.3, "west"
        await flown.until_phase("free")
        assert "release" not in [event["action"] for event in flown.values("event/failsafe")]


def hovers(flown):
    """The pilot has taken off by hand and hovers."""
    flights, places = flown.values("state/flight"), flown.values("state/position")
    heights = [place["altitude_above_start"] for place in places[-20:]]
    return flights and flights[-1]["is_flying"] and len(heights) == 20 and min(heights) > 1.5
