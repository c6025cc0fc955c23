"""The event loop before everything else on the machine, because a setpoint waits for it.

Beside a working vision thread an ordinary loop is late by whole time slices: the kernel lets the thread that runs go
on until its slice or the next tick ends (4 ms at 250 Hz without kernel preemption, measured p99 4 ms), whichever thread
it is. A real-time thread is woken at once. What is left is Python's interpreter lock.
"""

from __future__ import annotations

import asyncio
import gc
import os
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

SWITCH: Final = 0.0005
"""Switch interval of the interpreter [s]: the longest time for which another thread keeps the loop waiting between two
calls into OpenCV. Python's default of 5 ms exceeds a setpoint's whole budget."""
EYES: Final = "vision"
"""Name of the thread that looks at images: a stick frame that answers one waits for it as it does for the loop."""
CORES: Final = 2
"""From this number of cores on, vision leaves one to the loop."""
LOWEST_REAL_TIME: Final = 1
"""Above every ordinary thread, below everything else that is real-time."""

NICE: Final = -10
"""Of the process's other threads: a thread that holds the interpreter delays the loop, so no other program may keep
it waiting. On two cores shared with nine busy programs the loop stood still for 0.36 s otherwise."""
AUTOGROUP: Final = Path("/proc/self/autogroup")
"""Nice value of all programs of a session against those of other sessions: sched(7), "The autogroup feature"."""
THREADS: Final = Path("/proc/self/task")
THREADS_LOOK: Final = 2.0
"""Time between two looks for new threads [s]."""


def is_favoured(wanted: bool | None, environment: Mapping[str, str]) -> bool:
    """Whether this daemon goes before other programs.

    Args:
        wanted: what the configuration says; None where it leaves it open.
        environment: of the process; systemd sets NOTIFY_SOCKET only for a service, which runs nothing else.
    """
    return bool(environment.get("NOTIFY_SOCKET")) if wanted is None else wanted


def favour_loop() -> bool:
    """Put the calling thread, which is to run the event loop, before the process's other threads and other programs.

    Threads and processes started later are ordinary ones again. A loop that never sleeps is slowed to 95 % of a core by
    the kernel (sched(7), `sched_rt_runtime_us`) and ended by the watchdog.

    Returns:
        Whether the system allowed a real-time priority; it does to root and to whom `RLIMIT_RTPRIO` is granted, as
        `LimitRTPRIO=` in the service's unit does.
    """
    sys.setswitchinterval(min(sys.getswitchinterval(), SWITCH))
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(LOWEST_REAL_TIME))
    except OSError:
        return False
    return True


async def keep_threads_favoured() -> None:
    """Put the process's other threads, new ones too, before other programs, for ever.

    Without the right to it they stay as they are.
    """
    favour_session()
    while True:
        favour_threads()
        favour_eyes()
        await asyncio.sleep(THREADS_LOOK)


def favour_threads() -> bool:
    """Put the other threads of this process before other programs.

    Returns:
        Whether the system allowed it; it does to root and to whom `RLIMIT_NICE` is granted, as `LimitNICE=` in the
        service's unit does.
    """
    own = threading.get_native_id()
    try:
        threads = [int(task.name) for task in THREADS.iterdir()]
    except OSError:
        return False
    for thread in threads:
        if thread != own:
            try:
                with suppress(ProcessLookupError):
                    os.setpriority(os.PRIO_PROCESS, thread, NICE)
            except PermissionError:
                return False
    return True


def favour_eyes() -> bool:
    """Put the thread that looks at images beside the loop, where that has another core.

    On two cores beside busy programs (load 13) an image took 12 ms to the wire, p99 26, with this thread at a real-time
    priority, and 21, p99 51, with it at -10.

    Returns:
        Whether there is such a thread and the system allowed it, as for `favour_loop`.
    """
    if not hasattr(os, "sched_setscheduler") or len(os.sched_getaffinity(0)) < CORES:
        return False
    try:
        for thread in _eyes():
            with suppress(ProcessLookupError):
                os.sched_setscheduler(thread, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(LOWEST_REAL_TIME))
    except PermissionError:
        return False
    return bool(_eyes())


def _eyes() -> list[int]:
    return [thread.native_id for thread in threading.enumerate() if thread.name == EYES and thread.native_id]


def favour_session() -> bool:
    """Give the programs of this session priority over other sessions; a service has its own session.

    Where the kernel groups programs by session, which is the default of most distributions, nice values only compare
    programs of one session: threads at -10 beside four busy loops of another one were 16 ms late at worst, as at 0, and
    5 ms late with this.

    Returns:
        Whether the kernel groups programs so, and the system allowed it, as for `favour_threads`.
    """
    try:
        AUTOGROUP.write_text(f"{NICE}\n", encoding="ascii")
    except OSError:
        return False
    return True


def treat_threads_equally() -> None:
    """Take the real-time priorities back; what `favour_loop` and `favour_eyes` are measured against."""
    if hasattr(os, "sched_setscheduler"):
        for thread in (0, *_eyes()):
            with suppress(ProcessLookupError):
                # Only root may take the flag away again, and it does no harm.
                os.sched_setscheduler(thread, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def spare_collector() -> None:
    """Take what exists now out of the cyclic collector's sight, once everything is loaded.

    A full collection of the loaded program's 86,000 objects holds the interpreter for 40-110 ms; nothing of them ever
    becomes garbage.
    """
    gc.collect()
    gc.freeze()
