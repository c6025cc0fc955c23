"""The daemon dies in flight, ends in order, or cannot write to standard error; or its guard is killed.

Real processes, judged by what the simulated FlightCtrl holds: how long until its sticks are neutral, how long until it
is released, and that no stick frame follows. After a death only the guard can do that. Where nobody reads the daemon's
standard error it must fly on, and do the same when its pilot falls silent. A daemon that is started after a death
begins with a release, though the client notices nothing and goes on streaming. Without its guard a flight goes on, the
daemon says so at once, and nobody gets a new lease.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import time
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from lab.attack.floods import daemon_on_tcp
from lab.campaign import Row
from lab.cases import judged
from lab.rigs.cockpit import Boards
from lab.rigs.flown import Flown, flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import START, Sticks, daemon_process
from lab.rigs.sticks import first_words, last_words, steering
from lab.rigs.troubled import HOLD, TROUBLE, Trouble
from lab.rigs.waiting import following, wait_until
from mkdaemon import guard
from mkdaemon.daemon.priority import favour_loop, favour_threads
from mkdaemon.telemetry.refusals import Token

LIMITS: Final[dict[str, float | str]] = {"neutral": 0.35, "released": 1.1, "steered": 0, "lost": 0, "tracebacks": 0}
"""Of every attack [s]; docs/safety.md, "The guard"; see `attack`."""
RELEASES: Final[dict[str, float | str]] = LIMITS | {"words": "release"}
ORDERLY: Final[dict[str, float | str]] = RELEASES | {"took": 2.0, "exit_code": 0}
"""Of an end that a signal asks for."""
WATCH: Final = 3.0
"""How long the boards are watched after the release [s]."""
LOOK: Final = 0.02
"""Time between two looks at the boards [s]."""


class Death(StrEnum):
    """What happens to the daemon."""

    KILLED = "killed"
    ABORTED = "aborted"
    """As its watchdog does."""
    FROZEN = "frozen"
    HELD = "held"
    """A C call keeps the interpreter for `HOLD` and then returns."""
    BLOCKED = "standard error blocked"
    """Nobody reads it: the daemon flies on for `HOLD`, then the pilot falls silent; times from its last setpoint."""
    RESTARTED = "killed and started again"
    TERMINATED = "ended by SIGTERM"
    INTERRUPTED = "ended by SIGINT"


_SIGNALS: Final = {
    Death.KILLED: signal.SIGKILL,
    Death.ABORTED: signal.SIGABRT,
    Death.FROZEN: signal.SIGSTOP,
    Death.HELD: TROUBLE,
    Death.RESTARTED: signal.SIGKILL,
    Death.TERMINATED: signal.SIGTERM,
    Death.INTERRUPTED: signal.SIGINT,
}
_TROUBLES: Final = {Death.HELD: Trouble.HELD, Death.BLOCKED: Trouble.BLOCKED}
BOARDS: Final = tuple(Boards(fc, nc) for nc in (None, "0.24") for fc in ("early", "2.08", "2.12a"))


class ControlLostError(Exception):
    """Control was lost before anything was done to the daemon: that is no flight to judge."""


async def attack(boards: Boards, kind: Death, seed: int) -> Row:
    """Fly, attack the daemon, and watch the boards: on a pseudo terminal, with every second seed on a TCP port.

    Returns:
        `neutral`, until the FlightCtrl held neutral sticks or nothing [s]; `released`, until it held nothing [s];
        `steered`, frames with a control bit that came after the release; `lost`, control was lost while nobody read
        standard error; `tracebacks` in the log. After a new start `words`, what it wrote first; of an orderly end what
        was written last, `took` until the process was gone [s], and its `exit_code`.

    Raises:
        TimeoutError: the aircraft was never released.
        NotObeyedError: the flight did not begin.
        ControlLostError: control was lost before the attack.
    """
    favour_loop()  # who judges must not be starved by the machine's other programs
    rng = random.Random(f"{seed} {boards.name} {kind.value}")
    simulation = observed(seed, boards.fc, boards.nc, keeps=True)
    simulation.is_frozen = True  # until the daemon is there: on a busy machine the boards would cost it its start
    program = ("-m", "lab.rigs.troubled", _TROUBLES[kind].value) if kind in _TROUBLES else None
    async with (
        flown(simulation, on_tcp=seed % 2 == 0, program=program, log="info") as one,
        Pilot(one.client, "pilot") as pilot,
    ):
        await pilot.engage(lambda: simulation.is_controlled)
        pilot.sticks |= {"pitch": 40.0, "roll": -40.0}
        with suppress(TimeoutError):
            await wait_until(lambda: simulation.sticks is Sticks.STEERED)
        await asyncio.sleep(rng.uniform(0.2, 0.8))
        favour_threads()  # those that carry the pilot's setpoints, and his daemon's death
        if simulation.sticks is not Sticks.STEERED:
            raise ControlLostError(f"the boards hold {simulation.sticks.value}")
        found: dict[str, Any] = {"lost": False}
        if kind is Death.BLOCKED:
            found["lost"] = not await _flies_on_blocked(one)
            await pilot.stop()
            began = pilot.puts[-1]
        else:
            one.daemon.send_signal(_SIGNALS[kind])
            began = time.monotonic()
        await wait_until(lambda: simulation.sticks is not Sticks.STEERED)
        found["neutral"] = round(time.monotonic() - began, 3)
        await wait_until(lambda: not simulation.is_controlled)
        found["released"] = round(time.monotonic() - began, 3)
        limits = LIMITS
        if kind in {Death.TERMINATED, Death.INTERRUPTED}:
            limits, code = ORDERLY, await one.daemon.wait()
            found |= {"took": round(time.monotonic() - began, 3), "exit_code": abs(code)}
            found["words"] = last_words(simulation.written())
        simulation.heard.clear()
        if kind is Death.RESTARTED:
            limits, found["words"] = RELEASES, await _restart(one)
        else:
            await asyncio.sleep(WATCH)
        steered = steering(simulation.written()) + int(simulation.is_controlled)
        if kind is Death.HELD:
            steered = max(0, steered - 1)  # the daemon comes back and releases once more, level sticks first
        with suppress(ProcessLookupError):
            one.daemon.send_signal(signal.SIGKILL)
    return judged(limits, **found, steered=steered, tracebacks=one.daemon.errors.count("Traceback"))


async def _restart(one: Flown) -> str:
    """Start the next daemon, which the client finds and streams to as before; watch it; what it wrote first."""
    await asyncio.sleep(1.0)  # the guard may still write
    heard = len(one.simulation.heard)
    async with daemon_process(one.port, one.folder, endpoint=one.daemon.endpoint) as daemon:
        await wait_until(lambda: len(one.simulation.written(heard)) >= 20, START)
        await asyncio.sleep(WATCH)
        one.daemon.errors += daemon.errors
        return first_words(one.simulation.written(heard))


async def _flies_on_blocked(one: Flown) -> bool:
    """Block standard error, have something logged, and fly on: always steered, while that line waits to be written.

    Raises:
        TimeoutError: nothing waits to be written.
    """
    one.daemon.send_signal(TROUBLE)
    # Its refusal is a line of the log, at the level `info`; more of them would be a flood.
    await one.client.command("do", "nothing", {})
    await wait_until(lambda: _waits_to_write(one.daemon.pid), step=LOOK)
    return await _is_steered(one, time.monotonic() + HOLD) and _waits_to_write(one.daemon.pid)


async def _is_steered(one: Flown, end: float) -> bool:
    """Whether the FlightCtrl holds tilted sticks at every look until a time [s; monotonic]."""
    is_kept = True
    while time.monotonic() < end:
        await asyncio.sleep(LOOK)
        is_kept &= one.simulation.sticks is Sticks.STEERED
    return is_kept


def _waits_to_write(pid: int) -> bool:
    """Whether a thread waits for room in a pipe; root alone may see it."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that ended meanwhile
            if "pipe_write" in (task / "wchan").read_text(encoding="ascii"):
                return True
    return False


async def kill_guard(seed: int) -> Row:
    """Fly, and kill the guard.

    Returns:
        `noticed`, until `event/log` said so [s]; `token` of the refusal that a second client got, None where it got the
        lease; `lost`, the FlightCtrl was not under control all the time for `WATCH`.

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
        began = time.monotonic()
        os.kill(_guard_of(attacked.daemon.pid), signal.SIGKILL)
        await wait_until(lambda: any("guard is gone" in text for text in texts))
        noticed = round(time.monotonic() - began, 3)
        answer = await attacked.client.command("do", "lease", {"action": "take", "holder": "another", "force": True})
        is_kept = await _is_steered(attacked, began + WATCH)
    limits: dict[str, float | str] = {"noticed": 0.5, "token": Token.GUARD_DEAD, "lost": 0}
    return judged(limits, noticed=noticed, token=answer.token, lost=not is_kept)


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
