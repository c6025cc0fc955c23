"""The guard is killed in flight: who flies goes on, the daemon says so at once, and nobody gets a new lease."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from pathlib import Path
from typing import Final

from lab.attack.deaths import LOOK, WATCH
from lab.attack.floods import daemon_on_tcp
from lab.campaign import Row
from lab.rigs.pilot import Pilot
from lab.rigs.processes import Sticks
from lab.rigs.waiting import following, wait_until
from mkdaemon import guard
from mkdaemon.daemon.priority import favour_threads
from mkdaemon.telemetry.refusals import Token

NOTICE_LIMIT: Final = 0.5
"""The daemon says that its guard is gone within this time [s]."""


async def kill_guard(seed: int) -> Row:
    """Fly, and kill the guard.

    Returns:
        `noticed`, until `event/log` said so [s]; `token` of the refusal that a second client got, None where it got the
        lease; `kept`, the FlightCtrl was under control for `WATCH`; `is_wrong`, it breaks a limit.

    Raises:
        TimeoutError: the flight did not begin, or nothing was said.
    """
    texts: list[str] = []
    async with (
        daemon_on_tcp(seed, keeps=False) as attacked,
        Pilot(attacked.client, "pilot") as pilot,
        following(attacked.client, lambda sample: texts.append(str(sample.fields.get("text"))), "event/log"),
    ):
        simulation = attacked.simulation
        await pilot.engage(lambda: simulation.is_controlled)
        pilot.sticks |= {"pitch": 40.0}
        await wait_until(lambda: simulation.sticks is Sticks.STEERED)
        await asyncio.sleep(0.5)
        favour_threads()  # those that carry the pilot's setpoints
        began, is_kept = time.monotonic(), True
        os.kill(_guard_of(attacked.daemon.pid), signal.SIGKILL)
        await wait_until(lambda: any("guard is gone" in text for text in texts))
        noticed = round(time.monotonic() - began, 3)
        answer = await attacked.client.command("do", "lease", {"action": "take", "holder": "another", "force": True})
        while time.monotonic() - began < WATCH:
            await asyncio.sleep(LOOK)
            is_kept &= simulation.sticks is Sticks.STEERED
    return judged(noticed, answer.token, is_kept=is_kept)


def judged(noticed: float, token: str | None, *, is_kept: bool) -> Row:
    """The row of a guard that was killed; see `kill_guard`."""
    is_wrong = noticed > NOTICE_LIMIT or token != Token.GUARD_DEAD or not is_kept
    return {"noticed": noticed, "token": token, "kept": is_kept, "is_wrong": is_wrong}


def _guard_of(pid: int) -> int:
    """The guard of a daemon.

    Raises:
        LookupError: it has none.
    """
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text(encoding="ascii").split():
            if str(guard.__file__) in Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8"):
                return int(child)
    raise LookupError(f"process {pid} has no guard")
