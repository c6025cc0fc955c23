"""A flight in virtual time that goes on in a copy of its process: firmware, air and daemon as they are at a moment."""

from __future__ import annotations

import asyncio
import asyncio.events
import json
import os
import traceback
from collections.abc import Awaitable, Callable
from typing import Any


async def in_a_copy(work: Callable[[], Awaitable[dict[str, Any]]]) -> dict[str, Any] | None:
    """Let a copy of this process do some work on its virtual loop, and wait for it; nothing changes here.

    Args:
        work: what the copy does; what it returns crosses as JSON.

    Returns:
        What it returned; None where it ended without a word, which it prints.
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
