"""Nobody reads the daemon's standard error from one moment of the flight on: it flies on."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from lab.attack.flightlog import FlightLog, Gaps
from lab.attack.programs import HOLD
from lab.rigs.processes import DaemonProcess
from lab.rigs.troubled import TROUBLE
from lab.rigs.waiting import wait_until
from mkdaemon.client import Vehicle

LOOK: Final = 0.02
"""Time between two looks at the boards [s]."""


@dataclass(frozen=True, slots=True)
class Blocked:
    """`HOLD` of flight while a line of the log waits to be written.

    Attributes:
        kept: the aircraft was steered, never level and never released, and the line waited all the while.
        gaps: where setpoints were late.
        said: what became of the flight, each with its time [s]; empty where it was kept.
    """

    kept: bool
    gaps: Gaps
    said: tuple[str, ...] = ()


async def fly_on_blocked(daemon: DaemonProcess, client: Vehicle, log: FlightLog) -> Blocked:
    """Block standard error, have something logged, and fly on.

    Raises:
        TimeoutError: nothing waits to be written.
    """
    log.forget()
    daemon.send_signal(TROUBLE)
    # Its refusal is a line of the log, at the level `info`; more of them would be a flood.
    await client.command("do", "nothing", {})
    await wait_until(lambda: _waits_to_write(daemon.pid), step=LOOK)
    began, is_kept = time.monotonic(), True
    while time.monotonic() - began < HOLD:
        await asyncio.sleep(LOOK)
        is_kept &= log.look_at_boards()
    if not _waits_to_write(daemon.pid):
        log.say("the line of the log was written after all")
        is_kept = False
    return Blocked(is_kept, log.gaps(), () if is_kept else tuple(log.said))


def _waits_to_write(pid: int) -> bool:
    """Whether a thread waits for room in a pipe; root alone may see it."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that ended meanwhile
            if "pipe_write" in (task / "wchan").read_text(encoding="ascii"):
                return True
    return False
