"""The programs of examples/ run as they stand there: beside a daemon as processes, and in virtual time where they fly.

With the camera's images, and as two processes in real time, README's and the tutorials' flights are flown.
"""

from __future__ import annotations

import asyncio
import os
import re
import sys
from contextlib import asynccontextmanager

import msgpack
import pytest

from lab.places import ROOT
from lab.rigs.desk import desk
from lab.rigs.live import VEHICLE, live_daemon
from mkdaemon.bus.names import key
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
async def running(name, *arguments, endpoint):
    """An example as a process of its own."""
    pipe = asyncio.subprocess.PIPE
    program = (sys.executable, "-u", str(ROOT / "examples" / f"{name}.py"))
    environment = os.environ | {"MK_CONNECT": endpoint, "MK_VEHICLE": VEHICLE}
    process = await asyncio.create_subprocess_exec(*program, *arguments, stdout=pipe, stderr=pipe, env=environment)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def output_of(name, *arguments, endpoint):
    """What an example printed; it must end well."""
    async with asyncio.timeout(PATIENCE), running(name, *arguments, endpoint=endpoint) as process:
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
    assert [path.stem for path in EXAMPLES if not re.search(rf'\("{path.stem}"|examples/{path.stem}\.py', text)] == []


@pytest.mark.flight
async def test_telemetry_is_watched_while_a_recording_is_made_and_read_back(tmp_path):
    async with (
        live_daemon(board="nc") as flown,
        asyncio.timeout(PATIENCE),
        running("watch_telemetry", endpoint=flown.endpoint) as process,
    ):
        watched = []
        while not any("V " in line for line in watched) or len(watched) < 5:
            watched.append((await process.stdout.readline()).decode())
        process.terminate()
        lines = await output_of("record_and_read", str(tmp_path / "flights"), endpoint=flown.endpoint)
    for line in watched:
        assert re.fullmatch(
            r"roll [+-]\d+\.\d, pitch [+-]\d+\.\d, from nc/attitude\n|\d+\.\d V \d+\.\d s ago, link [a-z_]+\n", line
        ), line
    assert lines[0] == "marked: the interesting part begins"
    assert re.fullmatch(r"\d\d+ values of \d+ keys, 1 mark", lines[1])
    assert re.fullmatch(r"roll between [+-]\d\.\d{3} and [+-]\d\.\d{3} rad in \d+ attitudes", lines[2])


def test_settings_are_saved_changed_compared_and_restored(tmp_path):
    with desk(tmp_path, board="fc") as made:
        before = dict(made.simulation.flight.eeprom.sets)
        lines = made.type(f"python {ROOT}/examples/settings_backup.py {tmp_path}/backup").splitlines()
        assert made.simulation.flight.eeprom.sets == before
    assert "saved: set1.toml, set2.toml, set3.toml, set4.toml, set5.toml" in lines
    assert re.fullmatch(r"set 2: gyro_p was \d+, is 81", lines[-2])
    assert lines[-1].startswith("restored sets: 2")


class Flights:
    """Examples on a desk in virtual time.

    Attributes:
        phases: of control, each when it began.
    """

    def __init__(self, made):
        self._made, self.phases = made, []
        made.bus.subscribe(key("mk1", "control/status"), self._note)
        made.type("mkctl sim start")

    def _note(self, sample):
        phase = msgpack.unpackb(sample.payload)["phase"]
        self.phases += [phase] if self.phases[-1:] != [phase] else []

    def wait(self, seconds):
        self._made.type(f"sleep {seconds}")

    def fly(self, name):
        """Run one until its lease has ended; the lines that it prints."""
        lines = self._made.type(f"python {ROOT}/examples/{name}.py").splitlines()
        self.wait(2.0)
        assert self.phases[-1] == "free"
        return lines


def test_a_square_is_flown_by_sticks(tmp_path):
    with desk(tmp_path, pilot_plan=PilotPlan.SUPERVISE) as made:
        flights = Flights(made)
        flights.wait(10.0)
        lines = flights.fly("fly_by_sticks")
    assert [line.split()[0] for line in lines] == ["north", "east", "south", "west"]
    corners = [tuple(map(float, re.findall(r"-?\d+\.\d+", line)[:2])) for line in lines]
    assert corners[1][0] - corners[0][0] > 0.3, "east"
    assert corners[1][1] - corners[2][1] > 0.3, "south"
    assert corners[2][0] - corners[3][0] > 0.3, "west"


def test_a_flight_takes_off_and_lands(tmp_path):
    with desk(tmp_path) as made:
        flights = Flights(made)
        flights.wait(6.0)
        lines = flights.fly("take_off_and_land")
    assert re.fullmatch(r"landed: landed on .*", lines[-1])


def test_a_square_a_controller_of_ones_own_and_a_landing_are_flown_over_a_target(tmp_path):
    with desk(tmp_path, pilot_plan=PilotPlan.SUPERVISE) as made:
        flights = Flights(made)
        flights.wait(10.0)
        corners, moved = flights.fly("fly_square"), flights.fly("own_controller")
        landed = flights.fly("land_on_target")
    for line, (name, x, y) in zip(corners, CORNERS, strict=True):
        east, north, up = map(float, line.split()[1:])
        assert line.split()[0] == name
        assert abs(east - x) < 0.3, line
        assert abs(north - y) < 0.3, line
        assert abs(up - 2.0) < 0.3, line
    assert moved == ["there", "given back"]
    assert landed[-1].startswith("landed: landed on ")
    assert flights.phases[:13] == ["free", *["leased", "flying", "releasing", "free"] * 3]
