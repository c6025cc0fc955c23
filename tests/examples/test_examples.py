"""The programs of examples/ run as they stand there, each as a process of its own, against the simulator."""

from __future__ import annotations

import asyncio
import os
import re
import sys
from contextlib import asynccontextmanager
from itertools import groupby

import pytest

from lab.places import ROOT
from lab.rigs.live import VEHICLE, live_daemon
from lab.rigs.overtarget import VEHICLE as FLOWN
from lab.rigs.overtarget import Setting, hovering, over_target
from lab.rigs.waiting import wait_for
from mksim.config import PilotPlan
from tests.repeats import require_no_standstill

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
LONGEST = 60
"""Lines of a program; a user reads all of it before he copies it."""
CORNERS = (("middle", 0.0, 0.0), ("east", 0.4, 0.0), ("north", 0.4, 0.4), ("west", 0.0, 0.4), ("south", 0.0, 0.0))
"""Of the square over the target [m]."""
PATIENCE = 120.0
"""Longest time for a program [s]; a loaded machine is slow, not wrong."""


@asynccontextmanager
async def running(name, *arguments, endpoint, vehicle=VEHICLE):
    """An example as a process of its own."""
    pipe = asyncio.subprocess.PIPE
    program = (sys.executable, "-u", str(ROOT / "examples" / f"{name}.py"))
    environment = os.environ | {"MK_CONNECT": endpoint, "MK_VEHICLE": vehicle}
    process = await asyncio.create_subprocess_exec(*program, *arguments, stdout=pipe, stderr=pipe, env=environment)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def output_of(name, *arguments, endpoint, vehicle=VEHICLE):
    """What an example printed; it must end well."""
    async with asyncio.timeout(PATIENCE), running(name, *arguments, endpoint=endpoint, vehicle=vehicle) as process:
        out, err = await process.communicate()
        require_no_standstill(err.decode())
        assert (process.returncode, err) == (0, b""), f"{process.pid}: {(out + err).decode()}"
        return out.decode().splitlines()


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_says_what_it_does(path):
    text = path.read_text(encoding="utf-8")
    assert text.count("\n") < LONGEST
    assert re.match(r'"""[A-Z][^"]+\."?', text)


def test_all_examples_are_run_here():
    text = (ROOT / "tests" / "examples" / "test_examples.py").read_text(encoding="utf-8")
    assert [path.stem for path in EXAMPLES if f'("{path.stem}"' not in text] == []


@pytest.mark.flight
async def test_telemetry_is_watched():
    async with (
        live_daemon(board="nc") as flown,
        asyncio.timeout(PATIENCE),
        running("watch_telemetry", endpoint=flown.endpoint) as process,
    ):
        lines = []
        while not any("V " in line for line in lines) or len(lines) < 5:
            lines.append((await process.stdout.readline()).decode())
    for line in lines:
        assert re.fullmatch(
            r"roll [+-]\d+\.\d, pitch [+-]\d+\.\d, from nc/attitude\n|\d+\.\d V \d+\.\d s ago, link [a-z_]+\n", line
        ), line


@pytest.mark.flight
async def test_a_recording_is_made_and_read_back(tmp_path):
    async with live_daemon(board="nc") as flown:
        await flown.until(lambda: flown.values("state/attitude"))
        lines = await output_of("record_and_read", str(tmp_path / "flights"), endpoint=flown.endpoint)
    assert lines[0] == "marked: the interesting part begins"
    assert re.fullmatch(r"\d\d+ values of \d+ keys, 1 mark", lines[1])
    assert re.fullmatch(r"roll between [+-]\d\.\d{3} and [+-]\d\.\d{3} rad in \d+ attitudes", lines[2])


@pytest.mark.flight
async def test_settings_are_saved_changed_compared_and_restored(tmp_path):
    async with live_daemon() as flown:
        await flown.until(lambda: flown.values("state/flight") or flown.values("health"))
        before = dict(flown.runtime.simulation.flight.eeprom.sets)
        lines = await output_of("settings_backup", str(tmp_path / "backup"), endpoint=flown.endpoint)
        assert flown.runtime.simulation.flight.eeprom.sets == before
    assert "saved: set1.toml, set2.toml, set3.toml, set4.toml, set5.toml" in lines
    assert re.fullmatch(r"set 2: gyro_p was \d+, is 81", lines[-2])
    assert lines[-1].startswith("restored sets: 2")


@pytest.mark.flight
@pytest.mark.real_time(tolerance=0.1)
async def test_a_square_is_flown_by_sticks():
    async with live_daemon(board="nc", pilot_plan=PilotPlan.SUPERVISE, pilot_wait=PATIENCE) as flown:
        flown.runtime.simulation.start_pilot()
        await wait_for(lambda: hovers(flown), PATIENCE, 0.1)
        lines = await output_of("fly_by_sticks", endpoint=flown.endpoint)
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


@pytest.mark.flight
@pytest.mark.alone
@pytest.mark.real_time(tolerance=0.1)
async def test_a_flight_takes_off_and_lands():
    async with over_target(Setting(fps=10.0, pilot="start")) as flown:
        async with asyncio.timeout(PATIENCE):
            await flown.client.state.flight.until(lambda flight: flight.motors_running, patience=PATIENCE)
        lines = await output_of("take_off_and_land", endpoint=flown.endpoint, vehicle=FLOWN)
    assert re.fullmatch(r"landed: landed on .*", lines[-1])


@pytest.mark.flight
@pytest.mark.alone
@pytest.mark.real_time(tolerance=0.1)
async def test_a_square_a_controller_of_ones_own_and_a_landing_are_flown_over_a_target():
    async with hovering(Setting(fps=10.0)) as hover:

        async def fly(name):
            lines = await output_of(name, endpoint=hover.endpoint, vehicle=FLOWN)
            await wait_for(lambda: hover.seen.phases[-1].startswith("free"), PATIENCE)
            return lines

        corners = await fly("fly_square")
        moved = await fly("own_controller")
        await wait_for(hover.seen.is_hovering, PATIENCE, 0.1)
        landed = await fly("land_on_target")
    for line, (name, x, y) in zip(corners, CORNERS, strict=True):
        east, north, up = map(float, line.split()[1:])
        assert line.split()[0] == name
        assert abs(east - x) < 0.3, line
        assert abs(north - y) < 0.3, line
        assert abs(up - 2.0) < 0.3, line
    assert moved == ["there", "given back"]
    assert landed[-1].startswith("landed: landed on ")
    flown = ["free", "leased", "flying", "releasing", "free"]
    phases = [phase for phase, _ in groupby(words.partition(":")[0] for words in hover.seen.phases)]
    assert phases[:9] == flown + flown[1:]
    assert phases[-1] == "free"
