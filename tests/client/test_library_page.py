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
from tests.repeats import require_no_standstill

PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
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
        require_no_standstill(err.decode())
        assert (process.returncode, err) == (0, b""), (out + err).decode()
        return out.decode().splitlines()


def environment(flown):
    return os.environ | {"MK_CONNECT": flown.endpoint, "MK_VEHICLE": VEHICLE}


@pytest.mark.parametrize(("heading", "name"), [("Watch", "watch_telemetry"), ("Fly", "take_off_and_land")])
def test_the_page_shows_examples_as_they_are(heading, name):
    assert program(heading) == (ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8")


def test_readme_shows_the_flight_of_the_examples():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    example = (ROOT / "examples" / "take_off_and_land.py").read_text(encoding="utf-8")
    assert shown == example.partition("\n\n")[2]


def test_the_program_without_a_daemon_is_short():
    assert sum(bool(line.strip()) for line in program("Decode a capture").splitlines()) <= 10


async def test_a_capture_decodes_without_a_daemon(tmp_path):
    shutil.copy(ROOT / "tests/data/captures/nc_mixed_60s.jsonl", tmp_path / "flight.jsonl")
    lines = await output_of("Decode a capture", cwd=tmp_path)
    assert lines[0] == "  0.00 s  16.4 V, 9 satellites"
    assert "('OsdData5', 31)" in lines[-1]


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
