"""`python -m lab view`: what a viewer costs the daemon, also one that hangs, and how soon a long flight is seen.

Real time, a simulated FlightCtrl on a pseudo terminal, `mkdaemon run` and `mkctl view` as processes, and a page that
reads. A client streams sticks all the time, so that everything is published which a flight by hand publishes. The long
recording is the demonstration's, again and again with times that go on, until it has `ENTRIES` entries.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import statistics
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path
from typing import Annotated, Any, Final

import msgpack
from cyclopts import Parameter

from lab.rigs.flown import flown, observed
from lab.rigs.processes import MKCTL, START, VEHICLE, DaemonProcess, Program, connected, cpu_of
from lab.rigs.waiting import running
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.client import Vehicle
from mkdaemon.record.entry import Entry, unpacked
from mkdaemon.record.layout import Session
from mkdaemon.record.reader import Recording
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.virtualtime import run_virtually
from mksim.programs.rehearsal import rehearse

SETTLING: Final = 3.0
"""After a viewer has come or gone, before anything is counted [s]."""
ASKED: Final = 200
"""Questions whose answers are timed in each part."""


def main(
    *,
    seconds: Annotated[float, Parameter(help="Counted of each part of the alternation.")] = 10.0,
    rounds: Annotated[int, Parameter(help="Parts without and with a viewer.")] = 4,
    flight: Annotated[
        Path | None, Parameter(help="Recording of the demonstration; without it the demonstration is flown first.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Measure what a viewer costs, two minutes.

    Raises:
        TimeoutError: something did not start.
    """
    with tempfile.TemporaryDirectory() as folder:
        found = asyncio.run(_measure(Path(folder), seconds, rounds))
        found |= asyncio.run(open_recordings(Path(folder), flight))
    return show([{"what": "viewer"} | found], ("what",), as_json=as_json)


async def _measure(folder: Path, seconds: float, rounds: int) -> dict[str, Any]:
    """Processor time of the daemon and its answers, without a viewer, with one, and with one that hangs."""
    async with flown(observed(1), folder=folder) as one, connected(one.daemon.endpoint) as asker:
        daemon = one.daemon
        async with running(_steer(one.client)):
            costs = await _costs(daemon, seconds, rounds)
            return costs | {"answers_ms": await _hanging(daemon, asker)}


async def _costs(daemon: DaemonProcess, seconds: float, rounds: int) -> dict[str, Any]:
    """Processor time of the daemon without a viewer and with one, in turn."""
    used: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(rounds):
        used[False].append(await _cpu(daemon, seconds))
        async with viewer_process("--connect", daemon.endpoint) as (_, address), _page(address):
            used[True].append(await _cpu(daemon, seconds))
    alone, viewed = (100 * statistics.mean(used[is_viewed]) for is_viewed in (False, True))
    return {
        "cpu_percent_alone": round(alone, 2),
        "cpu_percent_viewed": round(viewed, 2),
        "cpu_ratio": round(viewed / alone, 3),
    }


async def _hanging(daemon: DaemonProcess, asker: Vehicle) -> dict[str, dict[str, float]]:
    """How soon the daemon answers: alone, beside a page that reads nothing, beside a viewer that was stopped."""
    found = {"alone": await _answers(asker)}
    async with viewer_process("--connect", daemon.endpoint) as (viewer, address), _stream(address, limit=1):
        await asyncio.sleep(SETTLING)
        found["page reads nothing"] = await _answers(asker)
        os.kill(viewer.pid, signal.SIGSTOP)
        await asyncio.sleep(SETTLING)
        found["viewer stopped"] = await _answers(asker)
        os.kill(viewer.pid, signal.SIGCONT)
    return found


async def _steer(uav: Vehicle) -> None:
    """Stream neutral sticks for ever."""
    async with uav.lease() as lease:
        while True:
            await lease.stick(pitch=0, roll=0, throttle=-50, seconds=10.0)


async def _cpu(daemon: DaemonProcess, seconds: float) -> float:
    """Processor time that the daemon uses a second, when things have settled."""
    await asyncio.sleep(SETTLING)
    began, used = time.monotonic(), daemon.cpu_s()
    await asyncio.sleep(seconds)
    return (daemon.cpu_s() - used) / (time.monotonic() - began)


async def _answers(asker: Vehicle) -> dict[str, float]:
    """How long the daemon takes to answer [ms]."""
    times = []
    for _ in range(ASKED):
        began = time.monotonic()
        await asker.control.status.latest()
        times.append(1e3 * (time.monotonic() - began))
        await asyncio.sleep(0.01)
    times.sort()
    return {"p50": round(times[ASKED // 2], 2), "p99": round(times[-1 - ASKED // 100], 2)}


@asynccontextmanager
async def _stream(address: str, limit: int = 1 << 24) -> AsyncIterator[asyncio.StreamReader]:
    """The stream of a page, as a browser opens it; half of what is taken from it ahead is `limit` [bytes]."""
    host = address.removeprefix("http://").strip("/")
    name, _, port = host.partition(":")
    reader, writer = await asyncio.open_connection(name, int(port), limit=limit)
    writer.write(f"GET /stream HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    try:
        yield reader
    finally:
        writer.transport.abort()


@asynccontextmanager
async def _page(address: str) -> AsyncIterator[None]:
    """What a browser does: it follows the stream."""
    async with _stream(address) as reader, running(_read(reader)):
        yield


async def _read(reader: asyncio.StreamReader) -> None:
    while await reader.read(1 << 16):
        pass


# -- long recordings ---------------------------------------------------------------------------------------------------

ENTRIES: Final = 100_000
"""Of the recording that is opened."""
FLUSHED: Final = 1000
"""Entries of a chunk; the recorder flushes once a second, which are as many of a flight with everything on."""
PAUSE: Final = 1.0
"""Between two flights of the recording [s]."""


async def open_recordings(folder: Path, flight: Path | None) -> dict[str, Any]:
    """Wall and processor time [s] of both programs.

    Args:
        folder: for the files.
        flight: recording that is repeated; None flies the demonstration first.
    """
    if flight is None:
        flight = folder / "flight.mcap"
        flown = rehearse(seed=1, wind="light", fps=15.0, watcher=lambda moment, status: None, recording=flight)
        await asyncio.to_thread(run_virtually, flown)
    file = folder / "long.mcap"
    write_long(flight, file)
    view_s, view_cpu_s = await _view(file)
    report_s, report_cpu_s = await _report(file)
    return {
        "entries": ENTRIES,
        "open_view_s": view_s,
        "open_view_cpu_s": view_cpu_s,
        "write_report_s": report_s,
        "write_report_cpu_s": report_cpu_s,
    }


@asynccontextmanager
async def viewer_process(*words: str) -> AsyncIterator[tuple[Program, str]]:
    """`mkctl view` as a process, and the address of its page.

    Args:
        words: further arguments: a file, or where a daemon is.
    """
    viewer = await Program.start(*MKCTL, "view", *words, "--no-browser", "--port", "0", "--json", "--vehicle", VEHICLE)
    try:
        async with asyncio.timeout(START):
            line = await viewer.first_line()
        yield viewer, json.loads(line)["address"]
    finally:
        await viewer.end(signal.SIGKILL)


async def _view(file: Path) -> tuple[float, float]:
    """From the start of `mkctl view FILE` until its page shows the aircraft's attitude."""
    began = time.monotonic()
    async with viewer_process(str(file)) as (viewer, address), _stream(address) as reader:
        await reader.readuntil(b"\r\n\r\n")
        async with asyncio.timeout(START):
            while True:
                shown = json.loads((await reader.readuntil(b"\n\n"))[6:])
                lines = {line["id"]: line["text"] for line in shown.get("lines", ())}
                if lines.get("attitude", "not known") != "not known":
                    break
        took, used = time.monotonic() - began, cpu_of(viewer.pid)
    return round(took, 2), round(used, 2)


async def _report(file: Path) -> tuple[float, float]:
    """From the start of `mkctl log report FILE` until its page is written."""
    before = _of_children()
    began = time.monotonic()
    words = ("log", "report", str(file), "-o", str(file.with_suffix(".html")), "--force")
    code, _ = await (await Program.start(*MKCTL, *words)).output()
    assert code == 0
    return round(time.monotonic() - began, 2), round(_of_children() - before, 2)


def _of_children() -> float:
    """Processor time of all processes that this one has started and that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system


def write_long(flight: Path, file: Path, entries: int = ENTRIES) -> None:
    """Write a recording of so many entries: a flight again and again, with stamps that go on.

    Args:
        flight: a recording.
        file: to write.
        entries: of it.
    """
    once = list(Recording(flight).entries())
    length = once[-1].received - once[0].received + PAUSE
    sequences = count()
    with file.open("wb") as output:
        writer = RecordingWriter(output, Session.begin("lab", "long", once[0].base, vehicle=once[0].vehicle))
        for number in range(entries):
            turn, place = divmod(number, len(once))
            writer.add(_later(once[place], turn * length, next(sequences)))
            if number % FLUSHED == 0:
                writer.flush()
        writer.finish()


def _later(entry: Entry, seconds: float, number: int) -> Entry:
    """An entry so much later, its stamp too."""
    fields = unpacked(entry.payload)
    payload, stamp = entry.payload, fields.get("stamp")
    if seconds and isinstance(stamp, dict):
        moved = {name: stamp[name] + seconds for name in ("monotonic", "wall")}
        payload = msgpack.packb(fields | {"stamp": stamp | moved})
    received, published = entry.received + seconds, entry.published + seconds
    return entry._replace(payload=payload, received=received, published=published, sequence=number)
