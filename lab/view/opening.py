"""How soon a long recording is seen: `mkctl view` until its page shows the aircraft, `mkctl log report` until it ends.

The recording is the demonstration's, again and again with times that go on, until it has `ENTRIES` entries.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path
from typing import Any, Final

import msgpack

from lab.rigs.processes import MKCTL, START, VEHICLE, Program, cpu_of
from mkdaemon.record.entry import Entry, unpacked
from mkdaemon.record.layout import Session
from mkdaemon.record.reader import Recording
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.virtualtime import run_virtually
from mksim.programs.rehearsal import rehearse

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
    async with viewer_process(str(file)) as (viewer, address):
        host = address.removeprefix("http://").strip("/")
        name, _, port = host.partition(":")
        reader, writer = await asyncio.open_connection(name, int(port), limit=1 << 24)
        writer.write(f"GET /stream HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        await reader.readuntil(b"\r\n\r\n")
        async with asyncio.timeout(START):
            while True:
                shown = json.loads((await reader.readuntil(b"\n\n"))[6:])
                lines = {line["id"]: line["text"] for line in shown.get("lines", ())}
                if lines.get("attitude", "not known") != "not known":
                    break
        took, used = time.monotonic() - began, cpu_of(viewer.pid)
        writer.transport.abort()
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
