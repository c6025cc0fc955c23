"""What the next daemon remembers: a flight behind a NaviCtrl, and how many cells the battery has."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.linkrig import virtually
from mkdaemon.clock import Clock
from mkdaemon.control.events import CellsKnown
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.cellnote import LOOK, CellNotes
from mkdaemon.daemon.cellnote import NAME as CELLS_NAME
from mkdaemon.daemon.flightnote import MOST_AGE, NAME, FlightNotes
from mkdaemon.virtualtime import run_virtually
from tests.control.test_batterywatch import battery

PORT = "/dev/virtual"
BEHIND = Boards("2.12a", "0.24")


def clock_of_loop():
    return Clock(monotonic=asyncio.get_running_loop().time, wall=lambda: 1.7e9 + asyncio.get_running_loop().time())


@asynccontextmanager
async def flying():
    """A cockpit whose aircraft has been in the air for six seconds."""
    async with cockpit(BEHIND, 1, rates={"osd": 200}) as flown:
        await asyncio.sleep(1.0)
        flown.aircraft.world.pilot.gas = 60
        flown.aircraft.flight.core.start()
        await asyncio.sleep(6.0)
        yield flown


class Silent:
    """A bus that nobody hears."""

    def publish(self, suffix, value, *, schema=None):
        """Forget it."""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The bytes of a real note, and what it says."""
    folder = tmp_path_factory.mktemp("note")

    async def fly():
        async with flying() as flown:
            memory = flown.link.flight_memory
            notes = FlightNotes(folder, PORT, clock_of_loop())
            notes.write(memory)
            return (folder / NAME).read_bytes(), memory, notes.read()

    return run_virtually(fly())


def notes_with(folder, raw, *, port=PORT, later=0.0):
    (folder / NAME).write_bytes(raw)
    at = json.loads(raw)["stamp"] if raw[:1] == b"{" and raw[-2:] == b"}\n" else {"monotonic": 0.0, "wall": 0.0}
    clock = Clock(monotonic=lambda: at["monotonic"] + later, wall=lambda: at["wall"] + later)
    return FlightNotes(folder, port, clock)


def test_a_note_of_another_port_or_an_old_one_is_none(written, tmp_path):
    raw = written[0]
    assert notes_with(tmp_path, raw, later=1.0).read() is not None
    assert notes_with(tmp_path, raw, later=1.0, port="/dev/other").read() is None
    assert notes_with(tmp_path, raw, later=MOST_AGE + 1).read() is None
    assert notes_with(tmp_path, raw, later=-5.0).read() is None


@settings(max_examples=16, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_wrong_file_is_no_note(written, tmp_path_factory, data):
    folder, raw = tmp_path_factory.getbasetemp(), bytearray(written[0])
    fields = json.loads(raw)
    match data.draw(st.integers(0, 3)):
        case 0:
            raw = bytearray(data.draw(st.binary(max_size=60)))
        case 1:
            raw = raw[: data.draw(st.integers(0, len(raw) - 2))]
        case 2:
            name = data.draw(st.sampled_from(sorted(set(fields) - {"stamp", "port"})))
            wrong = st.sampled_from(["x", -1, 1e99, [1], {}, True, [[]], 10**30])
            raw = bytearray(json.dumps(fields | {name: data.draw(wrong)}).encode() + b"\n")
        case _:
            raw = bytearray(json.dumps(fields | {data.draw(st.text(min_size=1, max_size=5)) + "?": 1}).encode() + b"\n")
    (folder / NAME).write_bytes(raw)
    clock = Clock(monotonic=lambda: fields["stamp"]["monotonic"] + 1, wall=lambda: fields["stamp"]["wall"] + 1)
    found = FlightNotes(folder, PORT, clock).read()
    assert found is None or json.loads(raw).keys() == fields.keys()


@virtually
async def test_the_note_is_there_while_the_aircraft_flies(tmp_path):
    async with flying() as flown:
        clock = clock_of_loop()
        notes = FlightNotes(tmp_path, PORT, clock)

        following = asyncio.create_task(_follow_in_this_thread(notes, flown.link, Audit(Silent(), clock)))
        await asyncio.sleep(2.0)
        assert notes.read() is not None
        flown.aircraft.flight.core.stop()
        await asyncio.sleep(3.0)
        assert not (tmp_path / NAME).exists()
        following.cancel()


async def _follow_in_this_thread(notes, link, audit):
    """Follow where virtual time knows no other threads."""
    with pytest.MonkeyPatch.context() as patch:

        async def here(work, *arguments):
            return work(*arguments)

        patch.setattr(asyncio, "to_thread", here)
        await notes.follow(link, audit)


class Log:
    def __init__(self):
        self.lines = []

    def log(self, level, text):
        self.lines.append((level, text))


async def followed(notes, facts, log=None):
    """What the flight core is told during the first look at the notes, and the next two."""
    fed, looks, sleep = [], 0, asyncio.sleep

    async def counted(seconds):
        nonlocal looks
        assert seconds == LOOK
        looks += 1
        await sleep(0)
        if looks == 3:
            raise asyncio.CancelledError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mkdaemon.daemon.cellnote.asyncio.sleep", counted)
        with pytest.raises(asyncio.CancelledError):
            await notes.follow(facts, fed.append, log or Log())
    return fed


def resting(voltage):
    facts = VehicleMemory()
    facts.motors_reported(False, 1.0)
    facts.state_received(battery(voltage), 1.0)
    return facts


async def test_cells_that_a_battery_shows_at_rest_are_remembered(tmp_path):
    assert await followed(CellNotes(tmp_path / "new", None), resting(14.6)) == [CellsKnown(4)]
    later = CellNotes(tmp_path / "new", None)
    assert later.read() == 4
    assert await followed(later, resting(12.8)) == [CellsKnown(4)]


async def test_configured_cells_count_and_nothing_else_is_remembered(tmp_path):
    notes = CellNotes(tmp_path, 6)
    assert await followed(notes, resting(14.6)) == [CellsKnown(6)]
    assert not (tmp_path / CELLS_NAME).exists()


async def test_a_folder_that_takes_nothing_is_reported_once(tmp_path):
    (tmp_path / "file").write_text("")
    log = Log()
    await followed(CellNotes(tmp_path / "file" / "x", None), resting(14.6), log)
    assert [level for level, _ in log.lines] == ["warning"]
