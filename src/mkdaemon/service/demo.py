"""`mkdaemon demo`: a simulated aircraft, the daemon, and a client that watches, in one command.

Simulator and daemon are processes of their own, as they would be in earnest; what is shown came over the bus.
"""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections import Counter
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Annotated, Any, Final

from cyclopts import Parameter
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.session import Client, Connection, Sample
from mkdaemon.cli.status import render as render_status
from mkdaemon.errors import MkError

VEHICLE: Final = "demo"
STARTUP: Final = 15.0
"""Longest time for simulator and daemon to start [s]; cold starts import a lot."""
ENDING: Final = 3.0
"""Time a process gets to end in order before it is killed [s]."""
ENOUGH: Final = ("state/attitude", "state/position", "state/battery", "link/health")
"""Telemetry has flowed when all of these have come."""


@dataclass
class Tally:
    """What a client has seen."""

    known: dict[str, Mapping[str, Any]] = field(default_factory=dict)
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

    @property
    def has_flowed(self) -> bool:
        """Whether telemetry of every kind that matters has come."""
        return all(suffix in self.known for suffix in ENOUGH)

    def rate(self, suffix: str) -> float:
        """Frames a second of a kind [Hz]."""
        span = self.ended - (self.began or 0.0)
        return self.frames[suffix] / span if span > 0 else 0.0


def demo(
    *,
    seconds: Annotated[float, Parameter(help="How long to watch.")] = 30.0,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), help="Print only the summary, as JSON.")] = False,
) -> int:
    """Fly the built-in aircraft for some seconds and show its telemetry, live.

    Needs no hardware and no terminal. Exit code 0 only when telemetry flowed.
    """
    return asyncio.run(_demo(seconds, as_json=as_json))


async def _demo(seconds: float, *, as_json: bool) -> int:
    tally, console = Tally(), Console()
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(name, stop.set)
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    say = Console(quiet=as_json).print
    say("starting the simulated aircraft and the daemon ...")
    async with _child("sim", "--pilot-wait", "3") as simulator:
        port = await _port_of(simulator)
        say(f"aircraft on {port}; daemon at {endpoint}, vehicle {VEHICLE}")
        run = ("run", "--port", f"pty:{port}", "--vehicle", VEHICLE, "--listen", endpoint, "--log", "error")
        async with _child(*run) as daemon, _connected(endpoint, daemon) as client, client.watch("**") as samples:
            # The link's state is put when it changes, which may have been before this client came.
            tally.known.update({suffix: last.fields for suffix, last in (await client.get("link/state")).items()})
            watching = asyncio.create_task(_watch(samples, tally, None if as_json else console), name="watch")
            with suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), seconds)
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)
    summary = summarise(tally)
    if as_json:
        print(json_line(summary))
    else:
        console.print(render_summary(tally, summary))
    return EXIT_OK if tally.has_flowed else EXIT_FAILURE


async def _watch(samples: AsyncIterator[Sample], tally: Tally, console: Console | None) -> None:
    """Take everything that comes; redraw on a terminal, be silent otherwise."""
    loop = asyncio.get_running_loop()
    if console is None or not console.is_terminal:
        async for sample in samples:
            tally.take(sample, loop.time())
        return
    shown_at = 0.0
    with Live(Text("waiting for telemetry ..."), console=console, auto_refresh=False) as live:
        async for sample in samples:
            tally.take(sample, now := loop.time())
            if now - shown_at > 0.2:
                shown_at = now
                live.update(Group(render_status(VEHICLE, tally.known), render_frames(tally)), refresh=True)


def render_frames(tally: Tally) -> Table:
    """Frames by kind."""
    table = Table("frame", "count", "Hz", title_justify="left")
    for suffix in sorted(tally.frames):
        table.add_row(suffix, str(tally.frames[suffix]), f"{tally.rate(suffix):.1f}")
    return table


def summarise(tally: Tally) -> dict[str, Any]:
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
        "latitude": position.get("latitude"),
        "longitude": position.get("longitude"),
        "position_enu": position.get("position_enu"),
    }


def render_summary(tally: Tally, summary: Mapping[str, Any]) -> Group:
    """The end of the demo."""
    flowed = tally.has_flowed
    missing = [suffix for suffix in ENOUGH if suffix not in tally.known]
    verdict = "telemetry flowed" if flowed else f"telemetry did NOT flow: nothing on {', '.join(missing)}"
    head = Text(f"{summary['seconds']:.1f} s: {verdict}", style="bold green" if flowed else "bold red")
    return Group(render_frames(tally), render_status(VEHICLE, tally.known), head)


@asynccontextmanager
async def _child(*arguments: str) -> AsyncIterator[Process]:
    """A `mkdaemon` of its own process; asked to end on leaving, killed if it does not."""
    command = (sys.executable, "-m", "mkdaemon.service.app", *arguments)
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


@asynccontextmanager
async def _connected(endpoint: str, daemon: Process) -> AsyncIterator[Client]:
    """A client of the daemon, as soon as it listens.

    Raises:
        MkError: the daemon ended, or never listened.
    """
    loop = asyncio.get_running_loop()
    deadline = loop.time() + STARTUP
    while True:
        try:
            async with Client.open(Connection(vehicle=VEHICLE, connect=endpoint)) as client:
                yield client
                return
        except MkError as error:
            if daemon.returncode is not None or loop.time() > deadline:
                raise MkError(f"the daemon did not start: {await _last_words(daemon) or error}") from error
            await asyncio.sleep(0.05)


async def _last_words(process: Process) -> str:
    """What a process that failed said last."""
    if process.returncode is None:
        process.terminate()
    assert process.stderr is not None
    with suppress(TimeoutError):
        async with asyncio.timeout(ENDING):
            lines = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
            return lines[-1] if lines else f"exit code {process.returncode}"
    return "no answer"


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
