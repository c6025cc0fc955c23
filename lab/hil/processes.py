"""What a process of the proving ground does not print, and a flight that goes on in a copy of it.

A copy has firmware, air and daemon as they are at a moment of virtual time.
"""

from __future__ import annotations

import asyncio
import asyncio.events
import ctypes
import json
import logging
import os
import sys
import traceback
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import structlog


def be_quiet() -> None:
    """Print no events of the daemon; let images be worked on by this thread alone."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    cv2.setNumThreads(1)  # a copy of the process would wait for threads that it has not got


@contextmanager
def aside() -> Iterator[None]:
    """Print on stderr what a library in C prints on stdout meanwhile: stdout may be JSON."""
    c = ctypes.CDLL(None)
    sys.stdout.flush()
    c.fflush(None)
    kept = os.dup(1)
    try:
        os.dup2(2, 1)
        yield
    finally:
        c.fflush(None)  # what it keeps in its buffer would come out later, on stdout
        os.dup2(kept, 1)
        os.close(kept)


async def in_a_copy(work: Callable[[], Awaitable[dict[str, Any]]]) -> dict[str, Any] | None:
    """Let a copy of this process do some work on its virtual loop, and wait for it; nothing changes here.

    Returns:
        What it returned, as JSON; None where it ended without a word, which it prints.
    """
    loop = asyncio.get_running_loop()
    reading, writing = os.pipe()
    child = os.fork()
    if child:
        os.close(writing)
        return _told(reading, child)
    try:
        asyncio.events._set_running_loop(loop)  # noqa: SLF001  # it was that of the process before the fork
        found = await work()
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(json.dumps(found).encode())
    except BaseException:  # noqa: BLE001  # whatever it is, the copy ends here and never returns into the flight
        traceback.print_exc()
    finally:
        os._exit(0)


def _told(reading: int, child: int) -> dict[str, Any] | None:
    """What a copy writes before it ends."""
    with os.fdopen(reading, "rb") as pipe:
        said = pipe.read()
    os.waitpid(child, 0)
    return dict(json.loads(said)) if said else None
