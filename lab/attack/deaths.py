"""The daemon is killed, aborted, frozen, held by a C call or out of memory in flight, and nobody starts it again.

Real processes, judged by what the simulated FlightCtrl holds: how long until its sticks are
neutral, how long until it is released, and that no stick frame follows. Only the guard can do that. Where nobody reads
the daemon's standard error it must fly on, and do the same when its pilot falls silent. Or the guard is killed: who
flies goes on, the daemon says so at once, and nobody gets a new lease.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Final

import zenoh

from lab.attack.floods import daemon_on_tcp
from lab.attack.programs import BLOCKED_DAEMON, HELD_DAEMON, HOLD, TROUBLE
from lab.campaign import Row
from lab.rigs.cockpit import Boards
from lab.rigs.flown import Flown, flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import VEHICLE, DaemonProcess, Sticks
from lab.rigs.waiting import following, wait_until
from lab.stories.kill import steering
from mkdaemon import guard
from mkdaemon.bus.session import session_config
from mkdaemon.daemon.priority import favour_loop, favour_threads
from mkdaemon.telemetry.refusals import Token

NEUTRAL_LIMIT: Final = 0.35
"""Sticks are neutral in the FlightCtrl this long after the attack [s]; docs/safety.md, "The guard"."""
RELEASE_LIMIT: Final = 1.1
"""The FlightCtrl is released this long after it [s]."""
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
    OUT_OF_MEMORY = "out of memory"
    """The kernel kills it; needs a memory cgroup (version 1) that may be written."""


_SIGNALS: Final = {
    Death.KILLED: signal.SIGKILL,
    Death.ABORTED: signal.SIGABRT,
    Death.FROZEN: signal.SIGSTOP,
    Death.HELD: TROUBLE,
}
_PROGRAMS: Final = {Death.HELD: ("-c", HELD_DAEMON), Death.BLOCKED: ("-c", BLOCKED_DAEMON)}
GREED: Final = 900_000
"""Length of a message that needs more memory than there is [bytes]."""
CGROUPS: Final = Path("/sys/fs/cgroup/memory")
BOARDS: Final = tuple(Boards(fc, nc) for nc in (None, "0.24") for fc in ("early", "2.08", "2.12a"))


class ControlLostError(Exception):
    """Control was lost before anything was done to the daemon: that is no flight to judge."""


async def attack(boards: Boards, kind: Death, seed: int) -> Row:
    """Fly, attack the daemon, and watch the boards: on a pseudo terminal, with every second seed on a TCP port.

    Returns:
        `neutral`, until the FlightCtrl held neutral sticks or nothing [s]; `released`, until it held nothing [s];
        `steered`, frames with a control bit that came after the release; `kept`, it flew on while nobody read standard
        error; `is_wrong`, it breaks a limit.

    Raises:
        TimeoutError: the aircraft was never released.
        NotObeyedError: the flight did not begin.
        ControlLostError: control was lost before the attack.
    """
    favour_loop()  # who judges must not be starved by the machine's other programs
    rng = random.Random(f"{seed} {boards.name} {kind.value}")
    simulation = observed(seed, boards.fc, boards.nc, keeps=True)
    simulation.is_frozen = True  # until the daemon is there: on a busy machine the boards would cost it its start
    async with (
        flown(simulation, on_tcp=seed % 2 == 0, program=_PROGRAMS.get(kind), log="info") as one,
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
        is_kept = True
        if kind is Death.BLOCKED:
            is_kept = await _flies_on_blocked(one)
            await pilot.stop()
            began = pilot.puts[-1]
        else:
            began = await _strike(one.daemon, kind)
        await wait_until(lambda: simulation.sticks is not Sticks.STEERED)
        neutral = time.monotonic() - began
        await wait_until(lambda: not simulation.is_controlled)
        released = time.monotonic() - began
        simulation.heard.clear()
        await asyncio.sleep(WATCH)
        steered = steering(b"".join(data for _, data in simulation.heard)) + int(simulation.is_controlled)
        if kind is Death.HELD:
            steered = max(0, steered - 1)  # the daemon comes back and releases once more, level sticks first
        with suppress(ProcessLookupError):
            one.daemon.send_signal(signal.SIGKILL)
    return judged(round(neutral, 3), round(released, 3), steered, is_kept=is_kept)


def judged(neutral: float, released: float, steered: int, *, is_kept: bool) -> Row:
    """The row of an attack; see `attack`."""
    is_wrong = neutral > NEUTRAL_LIMIT or released > RELEASE_LIMIT or steered > 0 or not is_kept
    return {"neutral": neutral, "released": released, "steered": steered, "kept": is_kept, "is_wrong": is_wrong}


async def _flies_on_blocked(one: Flown) -> bool:
    """Block standard error, have something logged, and fly on: always steered, while that line waits to be written.

    Raises:
        TimeoutError: nothing waits to be written.
    """
    one.daemon.send_signal(TROUBLE)
    # Its refusal is a line of the log, at the level `info`; more of them would be a flood.
    await one.client.command("do", "nothing", {})
    await wait_until(lambda: _waits_to_write(one.daemon.pid), step=LOOK)
    began, is_kept = time.monotonic(), True
    while time.monotonic() - began < HOLD:
        await asyncio.sleep(LOOK)
        is_kept &= one.simulation.sticks is Sticks.STEERED
    return is_kept and _waits_to_write(one.daemon.pid)


def _waits_to_write(pid: int) -> bool:
    """Whether a thread waits for room in a pipe; root alone may see it."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that ended meanwhile
            if "pipe_write" in (task / "wchan").read_text(encoding="ascii"):
                return True
    return False


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
    # One for each daemon: that of a process that is not quite gone cannot be removed yet, so the next one does that.
    for old in CGROUPS.glob("lab-attack-*"):
        if not Path("/proc", old.name.split("-")[2]).exists():
            with suppress(OSError):
                old.rmdir()
    group = CGROUPS / f"lab-attack-{pid}-{time.monotonic_ns()}"
    group.mkdir()
    try:
        # The limit first: pages that are in use already could not be taken back, and the kernel would refuse it.
        (group / "memory.limit_in_bytes").write_text("65536", encoding="ascii")
        (group / "cgroup.procs").write_text(str(pid), encoding="ascii")
        yield
    finally:
        for member in (group / "cgroup.procs").read_text(encoding="ascii").split():
            with suppress(OSError):
                (CGROUPS / "cgroup.procs").write_text(member, encoding="ascii")
        with suppress(OSError):
            group.rmdir()


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
    return judged_guard(noticed, answer.token, is_kept=is_kept)


def judged_guard(noticed: float, token: str | None, *, is_kept: bool) -> Row:
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
