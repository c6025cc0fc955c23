"""The daemon is killed, aborted, frozen, held by a C call or out of memory in flight, and nobody starts it again.

Real processes on a pseudo terminal, judged by what the simulated FlightCtrl holds: how long until its sticks are
neutral, how long until it is released, and that no stick frame follows. Only the guard can do that.
"""

from __future__ import annotations

import asyncio
import random
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Final

import zenoh

from lab.rigs.pilot import Pilot
from lab.rigs.processes import VEHICLE, DaemonProcess, ObservedSimulation, connected, daemon_process, wait_for_control
from lab.rigs.waiting import wait_until
from lab.stories.kill import steering
from mkdaemon.bus.session import session_config
from mkdaemon.config.sim import PilotPlan, SimConfig
from mkdaemon.daemon.priority import favour_loop
from mkdaemon.sim.runtime import Runtime

NEUTRAL_LIMIT: Final = 0.35
"""Sticks are neutral in the FlightCtrl this long after the attack [s]; docs/safety.md, "The guard"."""
RELEASE_LIMIT: Final = 1.1
"""The FlightCtrl is released this long after it [s]."""
WATCH: Final = 3.0
"""How long the boards are watched after the release [s]."""


class Death(StrEnum):
    """What happens to the daemon."""

    KILLED = "killed"
    ABORTED = "aborted"
    """As its watchdog does."""
    FROZEN = "frozen"
    HELD = "held"
    """A C call keeps the interpreter for `HOLD` and then returns."""
    OUT_OF_MEMORY = "out of memory"
    """The kernel kills it; needs a memory cgroup (version 1) that may be written."""


HOLD: Final = 3.0
"""How long the C call takes [s]."""
_SIGNALS: Final = {
    Death.KILLED: signal.SIGKILL,
    Death.ABORTED: signal.SIGABRT,
    Death.FROZEN: signal.SIGSTOP,
    Death.HELD: signal.SIGUSR1,
}
HELD_DAEMON: Final = f"""
import ctypes, signal, sys
libc = ctypes.PyDLL(None)  # keeps the interpreter, as a C library that does not let go of it
signal.signal(signal.SIGUSR1, lambda number, frame: libc.usleep({int(HOLD * 1e6)}))
from mkdaemon.cli.mkdaemon.app import main
main()
"""
"""A daemon that a signal holds up."""
GREED: Final = 900_000
"""Length of a message that needs more memory than there is [bytes]."""
CGROUPS: Final = Path("/sys/fs/cgroup/memory")
BOARDS: Final = tuple((fc, nc) for nc in (None, "0.24") for fc in ("early", "2.08", "2.12a"))
"""FlightCtrl, and the NaviCtrl in front of it."""


@dataclass(frozen=True, slots=True)
class Attack:
    """What one attack did.

    Attributes:
        boards: FlightCtrl and NaviCtrl.
        kind: what happened to the daemon.
        neutral: until the FlightCtrl held neutral sticks or nothing [s].
        released: until it held nothing [s].
        steered: frames with a control bit that came after the release.
    """

    boards: str
    kind: str
    neutral: float
    released: float
    steered: int

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        return self.neutral > NEUTRAL_LIMIT or self.released > RELEASE_LIMIT or self.steered > 0


async def attack(fc: str, nc: str | None, kind: Death, *, seed: int) -> Attack:
    """Fly, attack the daemon, and watch the boards.

    Raises:
        TimeoutError: the flight did not begin, or the aircraft was never released.
    """
    favour_loop()  # who judges must not be starved by the machine's other programs
    rng = random.Random(f"{seed} {fc} {nc} {kind.value}")
    board = {"board": "fc"} if nc is None else {"board": "nc", "nc": nc}
    fields = {**board, "fc": fc, "pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed}
    simulation = ObservedSimulation(SimConfig.model_validate(fields))
    runtime = Runtime(simulation)
    program = ("-c", HELD_DAEMON) if kind is Death.HELD else None
    with tempfile.TemporaryDirectory() as name:
        async with (
            runtime.serve(),
            daemon_process(f"pty:{runtime.port}", Path(name), program=program) as daemon,
            connected(daemon.endpoint) as client,
            Pilot(client, "pilot") as pilot,
        ):
            await wait_for_control(client)
            await pilot.engage(lambda: simulation.is_controlled)
            pilot.sticks |= {"pitch": 40.0, "roll": -40.0}
            await wait_until(lambda: not _is_neutral(simulation))
            await asyncio.sleep(rng.uniform(0.2, 0.8))
            began = await _strike(daemon, kind)
            neutral = asyncio.create_task(wait_until(lambda: _is_neutral(simulation)), name="neutral")
            await wait_until(lambda: not simulation.is_controlled)
            released = time.monotonic() - began
            simulation.heard.clear()
            await asyncio.sleep(WATCH)
            steered = steering(b"".join(data for _, data in simulation.heard)) + int(simulation.is_controlled)
            if kind is Death.HELD:
                steered = max(0, steered - 1)  # the daemon comes back and releases once more, level sticks first
            with suppress(ProcessLookupError):
                daemon.send_signal(signal.SIGKILL)
            boards = f"FC {fc}" if nc is None else f"FC {fc} behind NC {nc}"
            return Attack(boards, kind.value, round(await neutral, 3), round(released, 3), steered)


async def _strike(daemon: DaemonProcess, kind: Death) -> float:
    """Let it happen; returns when it did [s; monotonic]."""
    if kind is Death.OUT_OF_MEMORY:
        with zenoh.open(session_config("client", connect=[daemon.endpoint])) as greedy, memory_limit(daemon.pid):
            put = partial(greedy.put, f"mk/{VEHICLE}/setpoint/stick", bytes(GREED))
            while _is_alive(daemon.pid):
                await asyncio.to_thread(put)
    else:
        daemon.send_signal(_SIGNALS[kind])
    return time.monotonic()


def _is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@contextmanager
def memory_limit(pid: int) -> Iterator[None]:
    """Grant a process no more memory than it has.

    Raises:
        OSError: this machine has no memory cgroup that may be written.
    """
    # One for each daemon: that of a process that is not quite gone cannot be removed yet.
    group = CGROUPS / f"lab-attack-{pid}"
    group.mkdir()
    try:
        (group / "cgroup.procs").write_text(str(pid), encoding="ascii")
        (group / "memory.limit_in_bytes").write_text("65536", encoding="ascii")
        yield
    finally:
        for member in (group / "cgroup.procs").read_text(encoding="ascii").split():
            with suppress(OSError):
                (CGROUPS / "cgroup.procs").write_text(member, encoding="ascii")
        with suppress(OSError):
            group.rmdir()


def _is_neutral(simulation: ObservedSimulation) -> bool:
    external = simulation.flight.external
    held = external.held
    return not external.is_valid or (held.pitch, held.roll, held.yaw) == (0, 0, 0)
