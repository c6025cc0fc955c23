"""`mkdaemon demo --telemetry`: a simulated aircraft, the daemon, and a client that watches, in one command.

Simulator and daemon are separate processes, as with a real aircraft; all shown values came over the bus.
"""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections import Counter
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Final

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.cli.mkctl.status import render as render_status
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_OK, let_signals_kill
from mkdaemon.client import Sample, Vehicle, connect
from mkdaemon.errors import MkError
from mkdaemon.reading import Reading

VEHICLE: Final = "demo"
STARTUP: Final = 60.0
"""Longest time for simulator and daemon to start [s]; cold starts import a lot, and a loaded machine is slow."""
GRACE: Final = 30.0
"""How much longer than asked telemetry is waited for where it has not flowed yet [s]."""
ENDING: Final = 3.0
"""Time a process gets to end in order before it is killed [s]."""
REDRAW: Final = 0.2
"""Least time between two pictures on a terminal [s]."""
LINE_EVERY: Final = 5.0
"""Least time between two lines where there is no terminal [s]."""
ENOUGH: Final = ("state/attitude", "state/position", "state/battery", "link/health")
"""Telemetry has flowed when all of these have come."""


@dataclass
class DemoTally:
    """What a client has seen."""

    known: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    reading: Reading = field(default_factory=Reading)
    frames: Counter[str] = field(default_factory=Counter)
    began: float | None = None
    ended: float = 0.0

    def take(self, sample: Sample, now: float) -> None:
        """Count a sample and remember it."""
        self.began = now if self.began is None else self.began
        self.ended = now
        self.known[sample.suffix] = sample.fields
        if sample.suffix.startswith(("rx/", "tx/")):
            self.frames[sample.suffix] += 1
        else:
            self.reading.take(sample.suffix, sample.known, now - (sample.age or 0.0))

    @property
    def has_flowed(self) -> bool:
        """Whether telemetry of every kind that matters has come."""
        return all(suffix in self.known for suffix in ENOUGH)

    def rate(self, suffix: str) -> float:
        """Frames a second of a kind [Hz]."""
        span = self.ended - (self.began or 0.0)
        return self.frames[suffix] / span if span > 0 else 0.0


def watch_telemetry(seconds: float, *, as_json: bool) -> int:
    """Let the simulated pilot fly and show the daemon's telemetry; see `mkdaemon demo`.

    Raises:
        MkError: simulator or daemon did not start, or ended while it flew.
    """
    let_signals_kill()
    return asyncio.run(_demo(seconds, as_json=as_json))


async def _demo(seconds: float, *, as_json: bool) -> int:
    tally, console = DemoTally(), Console(quiet=as_json)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(name, stop.set)
    with reserved_endpoint() as endpoint:
        flight = asyncio.create_task(_fly(endpoint, seconds, tally, console), name="flight")
        stopped = asyncio.create_task(stop.wait(), name="stop")
        await asyncio.wait({flight, stopped}, return_when=asyncio.FIRST_COMPLETED)
        stopped.cancel()
        flight.cancel()  # whatever it waits for; the processes end in order
        # Ctrl-C on a terminal reaches the processes as well: then they ended because they were asked to.
        with suppress(asyncio.CancelledError, *([MkError] if stop.is_set() else [])):
            await flight
    if stop.is_set() and tally.began is None:
        return EXIT_INTERRUPTED
    summary = summarise(tally)
    if as_json:
        print(json_line(summary))
    else:
        console.print(render_summary(tally, summary))
    return EXIT_OK if tally.has_flowed else EXIT_FAILURE


async def _fly(endpoint: str, seconds: float, tally: DemoTally, console: Console) -> None:
    """Start everything, watch for `seconds`, longer only until telemetry flows; then end everything.

    Raises:
        MkError: a process did not start, or ended by itself; says which and why.
    """
    console.print("starting the simulated aircraft and the daemon ...")
    async with _child("sim", "--pilot-wait", "3", "--connect", endpoint, "--vehicle", VEHICLE) as simulator:
        port = await _port_of(simulator)
        console.print(f"aircraft on {port}; daemon at {endpoint}, vehicle {VEHICLE}")
        run = ("run", "--port", f"pty:{port}", "--vehicle", VEHICLE, "--listen", endpoint, "--log", "error")
        async with _child(*run, "--no-record") as daemon, AsyncExitStack() as stack:
            client = await _connect(stack, endpoint, daemon)
            samples = await stack.enter_async_context(client.watch("**"))
            # The link's state is put when it changes, which may have been before this client came.
            for last in (await client.get_all("link/state")).values():
                tally.take(last, asyncio.get_running_loop().time())
            jobs = [
                asyncio.create_task(_watch(samples, tally, console), name="watch"),
                asyncio.create_task(_must_live("simulator", simulator), name="simulator"),
                asyncio.create_task(_must_live("daemon", daemon), name="daemon"),
            ]
            try:
                ended, _ = await asyncio.wait(jobs, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
                if not ended and not tally.has_flowed:
                    jobs.append(asyncio.create_task(_until_flown(tally), name="grace"))
                    ended, _ = await asyncio.wait(jobs, timeout=GRACE, return_when=asyncio.FIRST_COMPLETED)
                for job in ended:
                    job.result()
            finally:
                for job in jobs:
                    job.cancel()
                await asyncio.gather(*jobs, return_exceptions=True)


async def _until_flown(tally: DemoTally) -> None:
    """Return as soon as telemetry has flowed."""
    while not tally.has_flowed:  # noqa: ASYNC110 - what has come is a state, not an event
        await asyncio.sleep(0.05)


async def _must_live(name: str, process: Process) -> None:
    """Wait for the end of a process that is not to end.

    Raises:
        MkError: it did; says why.
    """
    await process.wait()
    raise MkError(f"the {name} ended while it flew: {await _last_words(process)}")


async def _watch(samples: AsyncIterator[Sample], tally: DemoTally, console: Console) -> None:
    """Take everything that comes; redraw on a terminal, otherwise print a line now and then."""
    loop = asyncio.get_running_loop()
    shown_at, is_live = loop.time(), console.is_terminal
    with Live(Text("waiting for telemetry ..."), console=console, auto_refresh=False, transient=True) as live:
        async for sample in samples:
            tally.take(sample, now := loop.time())
            if now - shown_at < (REDRAW if is_live else LINE_EVERY):
                continue
            shown_at = now
            if is_live:
                live.update(
                    Group(render_status(VEHICLE, tally.reading.at(tally.ended)), render_frames(tally)), refresh=True
                )
            else:
                console.print(progress_line(tally))


def progress_line(tally: DemoTally) -> str:
    """The values received, in one line."""
    battery, position = tally.known.get("state/battery"), tally.known.get("state/position")
    words = [f"{tally.ended - (tally.began or 0.0):.0f} s", f"{tally.frames.total()} frames"]
    if battery is not None:
        words.append(f"{battery['voltage']:.1f} V")
    if position is not None:
        words.append(f"{position['latitude_deg']:.6f}, {position['longitude_deg']:.6f}")
        height = position["altitude_above_start"]
        words.append("height unknown" if height is None else f"{height:.1f} m above start")
    return "; ".join(words)


def render_frames(tally: DemoTally) -> Table:
    """Frames by kind."""
    table = Table("frame", "count", "Hz", title_justify="left")
    for suffix in sorted(tally.frames):
        table.add_row(suffix, str(tally.frames[suffix]), f"{tally.rate(suffix):.1f}")
    return table


def summarise(tally: DemoTally) -> dict[str, Any]:
    """What was seen, in figures."""
    span = tally.ended - (tally.began or 0.0)
    echo = tally.known.get("link/health", {}).get("echo", {})
    position = tally.known.get("state/position", {})
    battery = tally.known.get("state/battery", {})
    return {
        "telemetry_flowed": tally.has_flowed,
        "seconds": round(span, 2),
        "frames": dict(sorted(tally.frames.items())),
        "rates_hz": {suffix: round(tally.rate(suffix), 2) for suffix in sorted(tally.frames)},
        "echo_ms": {key: echo.get(f"{key}_ms") for key in ("p50", "p95", "p99")},
        "echo_lost": echo.get("lost"),
        "echo_sent": echo.get("sent"),
        "battery_v": battery.get("voltage"),
        "battery_used_mah": battery.get("used_mah"),
        "latitude_deg": position.get("latitude_deg"),
        "longitude_deg": position.get("longitude_deg"),
        "position_enu": position.get("position_enu"),
    }


def render_summary(tally: DemoTally, summary: Mapping[str, Any]) -> Group:
    """The end of the demo."""
    flowed = tally.has_flowed
    missing = [suffix for suffix in ENOUGH if suffix not in tally.known]
    verdict = "telemetry flowed" if flowed else f"telemetry did NOT flow: nothing on {', '.join(missing)}"
    head = Text(f"{summary['seconds']:.1f} s: {verdict}", style="bold green" if flowed else "bold red")
    return Group(render_frames(tally), render_status(VEHICLE, tally.reading.at(tally.ended)), head)


@asynccontextmanager
async def _child(*arguments: str) -> AsyncIterator[Process]:
    """A `mkdaemon` in its own process; asked to end on leaving, killed if it does not."""
    command = (sys.executable, "-m", "mkdaemon.cli.mkdaemon.app", *arguments)
    process = await asyncio.create_subprocess_exec(*command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.terminate()
        try:
            async with asyncio.timeout(ENDING):
                await process.communicate()
        except TimeoutError:
            process.kill()
            await process.communicate()


async def _port_of(simulator: Process) -> str:
    """The first line of the simulator's output names its port.

    Raises:
        MkError: it did not start; says why.
    """
    assert simulator.stdout is not None
    line = b""
    with suppress(TimeoutError):
        async with asyncio.timeout(STARTUP):
            line = await simulator.stdout.readline()
    if not line:
        raise MkError(f"the simulator did not start: {await _last_words(simulator)}")
    port: str = json.loads(line)["port"]
    return port


async def _connect(stack: AsyncExitStack, endpoint: str, daemon: Process) -> Vehicle:
    """Enter a client of the daemon into the stack, as soon as the daemon listens.

    Raises:
        MkError: the daemon ended, or never listened.
    """
    loop = asyncio.get_running_loop()
    deadline = loop.time() + STARTUP
    while True:
        try:
            return await stack.enter_async_context(connect(VEHICLE, endpoint))
        except MkError as error:
            if daemon.returncode is not None or loop.time() > deadline:
                raise MkError(f"the daemon did not start: {await _last_words(daemon) or error}") from error
            await asyncio.sleep(0.05)


async def _last_words(process: Process) -> str:
    """What a process that failed said last."""
    if process.returncode is None:
        process.terminate()
    elif process.returncode < 0:  # a killed process printed no reason: its last line is about something else
        return f"exit code {process.returncode}"
    assert process.stderr is not None
    with suppress(TimeoutError):
        async with asyncio.timeout(ENDING):
            lines = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
            return lines[-1] if lines else f"exit code {process.returncode}"
    return "no answer"
