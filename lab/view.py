"""`python -m lab view`: what a viewer costs the daemon, also one that hangs.

Real time, a simulated FlightCtrl on a pseudo terminal, `mkdaemon run` and `mkctl view` as processes, and a page that
reads. A client streams sticks all the time, so that everything is published which a flight by hand publishes.
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
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.rigs.flown import flown, observed
from lab.rigs.processes import MKCTL, START, VEHICLE, DaemonProcess, Program, connected
from lab.rigs.waiting import running
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.client import Vehicle

SETTLING: Final = 3.0
"""After a viewer has come or gone, before anything is counted [s]."""
ASKED: Final = 200
"""Questions whose answers are timed in each part."""


def main(
    *,
    seconds: Annotated[float, Parameter(help="Counted of each part of the alternation.")] = 10.0,
    rounds: Annotated[int, Parameter(help="Parts without and with a viewer.")] = 4,
    as_json: AsJson = False,
) -> int:
    """Measure what a viewer costs, two minutes.

    Raises:
        TimeoutError: something did not start.
    """
    with tempfile.TemporaryDirectory() as folder:
        found = asyncio.run(_measure(Path(folder), seconds, rounds))
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


@asynccontextmanager
async def viewer_process(*words: str) -> AsyncIterator[tuple[Program, str]]:
    """`mkctl view` as a process, and the address of its page.

    Args:
        words: further arguments.
    """
    viewer = await Program.start(*MKCTL, "view", *words, "--no-browser", "--port", "0", "--json", "--vehicle", VEHICLE)
    try:
        async with asyncio.timeout(START):
            line = await viewer.first_line()
        yield viewer, json.loads(line)["address"]
    finally:
        await viewer.end(signal.SIGKILL)
