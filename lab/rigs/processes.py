"""`mkdaemon run` as a process, simulated boards on a pseudo terminal, and clients on the bus, in real time.

Only what depends on the operating system, on Zenoh or on a process that dies needs it; everything else runs in virtual
time (`lab.rigs.cockpit`).
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, nullcontext, suppress
from enum import Enum
from pathlib import Path
from typing import Any, Final, Self

from lab.rigs.waiting import PATIENCE
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.client import Vehicle, connect
from mkdaemon.errors import MkError
from mksim.config import SimConfig
from mksim.simulation import Simulation

VEHICLE: Final = "stories"
START: Final = 150.0
"""Longest start of a daemon on a machine that is busy [s]."""
PROGRAM: Final = ("-m", "mkdaemon.cli.mkdaemon.app")
MKCTL: Final = ("-m", "mkdaemon.cli.mkctl.app")
ENDING: Final = 60.0
"""Longest end of a program that was asked to [s]."""


class Sticks(Enum):
    """What a FlightCtrl adds to its pilot's sticks."""

    STEERED = "tilted sticks"
    LEVEL = "level sticks"
    NOTHING = "nothing"


class ObservedSimulation(Simulation):
    """The simulated aircraft, keeping what the host wrote.

    Attributes:
        is_frozen: it stands still and says nothing.
        keeps: whether writes are kept in `heard`.
        heard: what the host wrote, each piece with its time [s; monotonic].
    """

    def __init__(self, config: SimConfig, *, keeps: bool = True) -> None:
        super().__init__(config)
        self.is_frozen = False
        self.keeps = keeps
        self.heard: list[tuple[float, bytes]] = []

    def write(self, data: bytes, at: float) -> None:
        """Send bytes to the board; see `Simulation.write`."""
        if self.keeps:
            self.heard.append((time.monotonic(), data))
        if not self.is_frozen:
            super().write(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run on; see `Simulation.advance`."""
        return [] if self.is_frozen else super().advance(to)

    def written(self, since: int = 0) -> bytes:
        """What the host wrote, from a piece of `heard` on."""
        return b"".join(data for _, data in self.heard[since:])

    @property
    def is_controlled(self) -> bool:
        """Whether the FlightCtrl holds a valid external control command."""
        return self.flight.external.is_valid

    @property
    def sticks(self) -> Sticks:
        """What the FlightCtrl holds."""
        external = self.flight.external
        held = external.held
        if not external.is_valid:
            return Sticks.NOTHING
        return Sticks.LEVEL if (held.pitch, held.roll, held.yaw) == (0, 0, 0) else Sticks.STEERED


def cpu_of(process: int) -> float:
    """Processor time that a process has used, by its id [s]."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Program:
    """What Python runs as a process of a session of its own.

    Attributes:
        errors: everything it wrote to stderr so far, complete once it has ended.
    """

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.errors = ""
        self._process = process
        self._reading = asyncio.create_task(self._read(), name="stderr")

    @classmethod
    async def start(cls, *words: str, threads: str = "", is_read: bool = True) -> Self:
        """Start it.

        Args:
            is_read: what it writes to standard output is read; else it goes nowhere.
        """
        more = {"ZENOH_RUNTIME": threads} if threads else {}
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            *words,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE if is_read else asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, **more, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # as a service: it goes before the programs of other sessions
        )
        return cls(process)

    @property
    def code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self._process.returncode

    @property
    def pid(self) -> int:
        """Its process number."""
        return self._process.pid

    async def _read(self) -> None:
        assert self._process.stderr is not None
        while line := await self._process.stderr.readline():
            self.errors += line.decode(errors="replace")

    async def first_line(self) -> str:
        """What it says first; empty where it ends without a word."""
        assert self._process.stdout is not None
        return (await self._process.stdout.readline()).decode(errors="replace").strip()

    async def output(self) -> tuple[int, str]:
        """Wait for its end; returns its exit code and what it wrote."""
        assert self._process.stdout is not None
        said = (await self._process.stdout.read()).decode(errors="replace")
        code = await self._process.wait()
        await self._reading
        return code, said

    async def wait(self) -> int:
        """Wait for its end; its exit code."""
        return await self._process.wait()

    def send_signal(self, number: signal.Signals) -> None:
        """Send a signal and do not wait."""
        with suppress(ProcessLookupError):
            self._process.send_signal(number)

    async def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Ask it to end, kill it if it does not; returns its exit code."""
        self.send_signal(number)
        try:
            async with asyncio.timeout(ENDING):
                code = await self._process.wait()
        except TimeoutError:
            self._process.kill()
            code = await self._process.wait()
        await self._reading
        return code

    def resident_mb(self) -> float:
        """Memory it holds [MiB]."""
        pages = int(Path(f"/proc/{self.pid}/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 2**20

    def most_resident_mb(self) -> float:
        """Most memory it has held at any time [MiB]."""
        status = Path(f"/proc/{self.pid}/status").read_text(encoding="ascii")
        return float(status.partition("VmHWM:")[2].split()[0]) / 1024

    def descriptors(self) -> int:
        """Files, sockets and devices it holds open."""
        return sum(1 for _ in Path(f"/proc/{self.pid}/fd").iterdir())

    def cpu_s(self) -> float:
        """Processor time it has used [s]."""
        return cpu_of(self.pid)


class DaemonProcess(Program):
    """One `mkdaemon run`.

    Attributes:
        endpoint: where its bus listens.
    """

    endpoint: str


async def start_daemon(
    config: Path, endpoint: str, program: Sequence[str] = PROGRAM, log: str = "warning"
) -> DaemonProcess:
    """Start a daemon with a configuration file.

    Args:
        program: what Python runs in place of the daemon's own program.
        log: the least severity it writes.
    """
    words = ("run", "--config", str(config), "--real-time", "--listen", endpoint, "--log", log)
    daemon = await DaemonProcess.start(*program, *words)
    daemon.endpoint = endpoint
    return daemon


@asynccontextmanager
async def daemon_process(
    port: str,
    folder: Path,
    *,
    link: str = "",
    endpoint: str | None = None,
    program: Sequence[str] | None = None,
    log: str = "warning",
) -> AsyncIterator[Any]:
    """Run a daemon on a port while the context lasts.

    Args:
        link: further lines of the `link` section.
        endpoint: where its bus listens; a free one by default.
        program: what Python runs in place of the daemon's own program.
    """
    config = folder / "daemon.toml"
    config.write_text(
        f'[vehicle]\nname = "{VEHICLE}"\nstate_folder = "{folder}/state"\n[link]\nport = "{port}"\n{link}\n',
        encoding="utf-8",
    )
    with reserved_endpoint() if endpoint is None else nullcontext(endpoint) as where:
        daemon = await start_daemon(config, where, program or PROGRAM, log)
        try:
            yield daemon
        finally:
            await daemon.end(signal.SIGKILL)


@asynccontextmanager
async def connected(endpoint: str, vehicle: str = VEHICLE, *, patience: float = PATIENCE) -> AsyncIterator[Vehicle]:
    """A client of its own session, as soon as the daemon answers.

    Raises:
        TimeoutError: nobody answered.
    """
    async with asyncio.timeout(patience):
        while True:
            opening = connect(vehicle, endpoint)
            try:
                client = await opening.__aenter__()
            except MkError:
                await asyncio.sleep(0.05)
                continue
            if vehicle in await client.vehicles():
                break
            await opening.__aexit__(None, None, None)
    try:
        yield client
    finally:
        await opening.__aexit__(None, None, None)


async def wait_for_control(client: Vehicle, within: float = PATIENCE) -> None:
    """Return when the daemon would grant a lease.

    Raises:
        TimeoutError: it would not.
    """
    async with asyncio.timeout(within):
        while True:
            state = await client.get("link/state")
            if state and state.fields["external_control"] and state.fields["condition"] in {"up", "degraded"}:
                return
            await asyncio.sleep(0.05)
