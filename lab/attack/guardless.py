"""The guard is killed in flight: who flies goes on, the daemon says so at once, and nobody gets a new lease."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from lab.attack.flightlog import Gaps, flight_log
from lab.attack.flown import daemon_on_tcp
from lab.rigs.lateness import measured_lateness
from lab.rigs.pilot import Pilot
from lab.rigs.processes import Sticks
from lab.rigs.waiting import wait_until
from mkdaemon import guard
from mkdaemon.daemon.priority import favour_threads
from mkdaemon.telemetry.refusals import Token

NOTICE_LIMIT: Final = 0.5
"""The daemon says that its guard is gone within this time [s]."""
WATCH: Final = 3.0
"""How long the flight goes on [s]."""


@dataclass(frozen=True, slots=True)
class GuardDeath:
    """One guard killed.

    Attributes:
        noticed: until `event/log` said so [s].
        token: of the refusal that a second client got; None where it got the lease.
        kept: the FlightCtrl was under control all the while.
        late: the machine was late by so long at most, and so may be `noticed` [s]; see `lab.rigs.lateness`.
        gaps: where setpoints were late; None where that was not measured.
        said: what the daemon published meanwhile, each with its time [s]; empty where control was kept.
    """

    noticed: float
    token: str | None
    kept: bool
    late: float = 0.0
    gaps: Gaps | None = None
    said: tuple[str, ...] = ()

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        return self.noticed > NOTICE_LIMIT or self._is_lost

    @property
    def is_machine_late(self) -> bool:
        """Whether it is wrong, and would hold without the lateness of the machine; it counts as wrong all the same."""
        return self.is_wrong and self.noticed - self.late <= NOTICE_LIMIT and not self._is_lost

    @property
    def _is_lost(self) -> bool:
        return self.token != Token.GUARD_DEAD or not self.kept


async def kill_guard(seed: int) -> GuardDeath:
    """Fly, and kill the guard.

    Raises:
        TimeoutError: the flight did not begin, or nothing was said.
    """
    async with (
        daemon_on_tcp(seed) as attacked,
        Pilot(attacked.client, "pilot") as pilot,
        flight_log(attacked.client, pilot, attacked.simulation) as log,
        measured_lateness() as lateness,
    ):
        simulation, daemon, client = attacked.simulation, attacked.daemon, attacked.client
        await pilot.engage(lambda: simulation.is_controlled)
        pilot.sticks |= {"pitch": 40.0}
        await wait_until(lambda: simulation.sticks is Sticks.STEERED)
        await asyncio.sleep(0.5)
        favour_threads()  # those that carry the pilot's setpoints
        log.forget()
        lateness.forget()
        began = time.monotonic()
        os.kill(_guard_of(daemon.pid), signal.SIGKILL)
        await wait_until(lambda: any("guard is gone" in text for text in log.said))
        noticed = time.monotonic() - began
        request = {"action": "take", "holder": "another", "force": True}
        answer = await client.command("do", "lease", request)
        is_kept = True
        while time.monotonic() - began < WATCH:
            await asyncio.sleep(0.02)
            is_kept &= log.look_at_boards()
        late = round(max(lateness.loop, lateness.thread), 3)
        said = () if is_kept else tuple(log.said)
        return GuardDeath(round(noticed, 3), answer.token, is_kept, late, log.gaps(), said)


def _guard_of(pid: int) -> int:
    """The guard of a daemon.

    Raises:
        LookupError: it has none.
    """
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text(encoding="ascii").split():
            if str(guard.__file__) in Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8"):
                return int(child)
    msg = f"process {pid} has no guard"
    raise LookupError(msg)
