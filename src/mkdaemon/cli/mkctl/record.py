"""`mkctl log record`: a recording on the ground, of everything that vehicles put on the bus."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import Parameter

from mkdaemon.cli.arguments import Count, Length
from mkdaemon.cli.interrupts import run_until_asked_to_end
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line, picked
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.promptness import favour_threads
from mkdaemon.cli.sparkline import sparkline
from mkdaemon.files import user_folder

if TYPE_CHECKING:
    from mkdaemon.client.groundrecorder import GroundPlan, GroundRecording

REDRAW: Final = 0.25
"""Time between two progress lines on a terminal [s]."""
LINE_EVERY: Final = 60.0
"""Time between two lines where there is no terminal [s]."""
MEGA: Final = 1_000_000
TREND: Final = 20
"""Seconds whose numbers of values are shown as bars."""


async def record(
    *,
    folder: Annotated[Path | None, Parameter(name=["--folder", "-o"])] = None,
    key: Annotated[tuple[str, ...], Parameter(name=["--key", "-k"])] = (),
    also: Annotated[tuple[str, ...], Parameter(help="Endpoint of a further daemon.")] = (),
    seconds: Length | None = None,
    no_viewer: bool = False,
    file_mb: Count = 500,
    file_minutes: Length = 60.0,
    total_mb: Count = 20_000,
    free_mb: Count = 1000,
    delete_oldest: bool = False,
    queue_mb: Count = 64,
    connection: Connection = HERE,
) -> int:
    """Record everything that vehicles put on the bus, until Ctrl-C. Waits for a daemon that is not there yet.

    Exit code 0 only if everything that was seen is in the file. Loss on the way is counted by the daemon's own counts.

    Example: mkctl log record --folder recordings --seconds 600

    Args:
        folder: Where files go; by default `ground/recordings` in the user's state folder.
        key: Key expressions that are recorded: default `mk/**`, every vehicle. What begins with `@` is matched by no
            wildcard and must be given in full; images of a simulated camera are recorded with 'mk/*/sim/camera/*' only.
        also: Further endpoints, beside that of `--connect`.
        seconds: End after this time [s].
        no_viewer: Leave out the JSON for Foxglove, Lichtblick and PlotJuggler.
        file_mb: A new file at this size [MB].
        file_minutes: A new file at this age [min].
        total_mb: All recordings in the folder together [MB].
        free_mb: Left free on the disk [MB].
        delete_oldest: Delete the oldest recordings of the folder where there is no more room; else recording stops.
        queue_mb: Largest amount that may wait in memory for a slow disk [MB].

    Raises:
        ConfigError: an option cannot be.
        MkError: the disk took nothing at the end.
    """
    from mkdaemon.client.groundrecorder import EVERYTHING, GroundPlan
    from mkdaemon.record.folder import RoomLimits

    plan = GroundPlan(
        endpoints=(connection.connect, *also),
        folder=folder or user_folder("XDG_STATE_HOME") / "ground" / "recordings",
        limits=RoomLimits(file_mb * MEGA, file_minutes * 60, total_mb * MEGA, free_mb * MEGA, delete_oldest),
        expressions=key or EVERYTHING,
        zenoh_file=connection.zenoh_file,
        queue_bytes=queue_mb * MEGA,
        has_json=not no_viewer,
    )
    favour_threads()
    recording, took = await _record(plan, seconds, is_quiet=connection.json)
    _print_summary(recording, took, as_json=connection.json)
    return EXIT_OK if not recording.queue.lost else EXIT_FAILURE


async def _record(plan: GroundPlan, seconds: float | None, *, is_quiet: bool) -> tuple[GroundRecording, float]:
    """Record until a signal, or for some seconds; returns the recording and how long it took [s]."""
    from mkdaemon.client.groundrecorder import record_ground

    began = time.monotonic()
    async with record_ground(plan) as recording:
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await run_until_asked_to_end(_show(recording, plan.endpoints, began, is_quiet=is_quiet))
    return recording, time.monotonic() - began


async def _show(recording: GroundRecording, endpoints: Sequence[str], began: float, *, is_quiet: bool) -> None:
    """Show how it goes, for ever."""
    from rich.text import Text

    from mkdaemon.cli.console import Console

    console = Console(stderr=True)
    rate = Rate()
    if console.is_terminal and not is_quiet:
        with console.status(Text()) as status:
            while True:
                seconds = time.monotonic() - began
                rate.take(recording.received, seconds)
                status.update(Text(f"{_line(recording, endpoints, seconds)}  {rate.shown()}"))
                await asyncio.sleep(REDRAW)
    while True:
        if not is_quiet:
            console.print(_line(recording, endpoints, time.monotonic() - began))
        await asyncio.sleep(LINE_EVERY)


class Rate:
    """How many values came in each of the last seconds."""

    def __init__(self) -> None:
        self._counts: deque[int] = deque(maxlen=TREND)
        self._received, self._at = 0, 0.0

    def take(self, received: int, at: float) -> None:
        """Take how many have come since the beginning until a time [s]; looks once a second."""
        if at - self._at >= 1.0:
            self._counts.append(received - self._received)
            self._received, self._at = received, at

    def shown(self) -> str:
        """Bars and the newest number; empty in the first second."""
        if not self._counts:
            return ""
        return f"{sparkline(self._counts, TREND, least=0.0)} {self._counts[-1]} values/s"


def _line(recording: GroundRecording, endpoints: Sequence[str], seconds: float) -> str:
    """How it goes, in one line."""
    report = recording.report
    silent = [one for one in endpoints if one not in recording.connected]
    words = [f"{seconds:.0f} s", f"{recording.received} values", f"{report.file_bytes / 1e6:.1f} MB"]
    if recording.tap.vehicles:
        words.append(", ".join(sorted(recording.tap.vehicles)))
    if recording.queue.size > MEGA:
        words.append(f"{recording.queue.size / 1e6:.0f} MB wait")
    if recording.lost_on_the_way:
        words.append(f"{recording.lost_on_the_way} lost on the way")
    if recording.queue.lost:
        words.append(f"{recording.queue.lost} not written")
    if silent:
        words.append(f"waiting for {', '.join(silent)}")
    if report.reason:
        words.append(f"NOT RECORDING: {report.reason}")
    return "; ".join(words)


def _print_summary(recording: GroundRecording, seconds: float, *, as_json: bool) -> None:
    report, queue = recording.report, recording.queue
    if as_json:
        vehicles: dict[str, Any] = {
            name: {"received": tally.received, "lost": dict(tally.lost)}
            for name, tally in recording.tap.vehicles.items()
        }
        written = {"written": report.entries, "not_written": queue.lost, "vehicles": vehicles}
        found = {"file": report.file, "seconds": seconds, **picked(recording, "received", "lost_on_the_way"), **written}
        print(json_line(found))
        return
    file = "no file" if report.file is None else str(report.file)
    print(f"{file}: {report.entries} values in {seconds:.0f} s")
    for name, tally in sorted(recording.tap.vehicles.items()):
        lost = f"; {tally.lost.total()} lost on the way" if tally.lost else ""
        print(f"  {name}: {tally.received} values{lost}")
        for key, number in tally.lost.most_common(5):
            print(f"    {number} of {key}")
    if queue.lost:
        print(f"  {queue.lost} values were not written: {report.reason or 'the disk was too slow'}")
