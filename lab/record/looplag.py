"""How late the event loop is woken beside the recorder's thread, in turns with and without it, in one process."""

from __future__ import annotations

import asyncio
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from lab.record.writing import BASE, SESSION, made_values
from mkdaemon.bus.schema import schema_json
from mkdaemon.clock import Clock
from mkdaemon.daemon.priority import SWITCH
from mkdaemon.record.folder import RecordingFolder, RoomLimits
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.recorder import Recorder, RecorderThread
from mkdaemon.record.tap import Tap
from mkdaemon.record.view import JsonView

TICK: Final = 0.002
"""Time between two turns of the loop [s]; each of them also publishes."""
A_TURN: Final = 3
"""Values in each: 1,500 a second."""
SEGMENT: Final = 3.0
"""Length of each measurement [s]."""


def measure(turns: int) -> dict[str, Any]:
    """Lateness of the loop [ms] without a recorder, with one, and with one that adds JSON.

    Args:
        turns: of each, one after the other.
    """
    switch = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH)  # as in the daemon
    try:
        return asyncio.run(_measure(turns))
    finally:
        sys.setswitchinterval(switch)


async def _measure(turns: int) -> dict[str, Any]:
    values = list(made_values(3000))
    late: dict[str, list[float]] = {"off": [], "on": [], "json": []}
    for turn in range(turns):
        for name, found in late.items():
            with tempfile.TemporaryDirectory() as folder:
                found += await _segment(Path(folder), name, turn, values)
    return {name: _figures(found) for name, found in late.items()}


async def _segment(folder: Path, name: str, turn: int, values: Sequence[tuple[str, bytes, str]]) -> list[float]:
    limits = RoomLimits(10**9, 3600.0, 10**9, 1, may_delete=False)
    queue, clock = EntryQueue(32_000_000), Clock()
    recorder = Recorder(
        queue,
        RecordingFolder(folder, "lab", limits),
        replace(SESSION, part=turn),
        view=JsonView(schema_json) if name == "json" else None,
        sync_period=1.0,
    )
    thread = RecorderThread(recorder)
    thread.start()
    tap = Tap(queue, clock, "mk1", BASE)
    loop = asyncio.get_running_loop()
    late: list[float] = []
    at, end, number = loop.time(), loop.time() + SEGMENT, 0
    while at < end:
        at += TICK
        await asyncio.sleep(at - loop.time())
        late.append(max(loop.time() - at, 0.0))
        for suffix, payload, encoding in values[number : number + A_TURN]:
            if name != "off":
                tap.sample(suffix, payload, encoding, None)
        number = (number + A_TURN) % (len(values) - A_TURN)
    await asyncio.to_thread(thread.stop)
    return late


def _figures(late: list[float]) -> dict[str, float]:
    late.sort()
    shares = {"p50_ms": 0.5, "p99_ms": 0.99, "p999_ms": 0.999}
    figures = {name: 1e3 * late[int(share * len(late))] for name, share in shares.items()}
    return {**figures, "max_ms": 1e3 * late[-1], "turns": len(late)}
