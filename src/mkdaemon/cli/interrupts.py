"""Programs that go on until they are asked to end."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, Final

from mkdaemon.client.taskerrors import background

_ENDS: Final = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def asked_to_end() -> Iterator[asyncio.Event]:
    """An event that Ctrl-C and SIGTERM set, in place of ending the program; a closed terminal is as Ctrl-C."""
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    for name in _ENDS:
        loop.add_signal_handler(name, stop.set)
    try:
        yield stop
    finally:
        for name in _ENDS:
            loop.remove_signal_handler(name)


async def until_asked_to_end() -> None:
    """Wait for Ctrl-C or SIGTERM: the program ends in order, with exit code 0."""
    with asked_to_end() as stop:
        await stop.wait()


async def run_until_asked_to_end(work: Coroutine[Any, Any, None]) -> None:
    """Do something until it ends, or until Ctrl-C or SIGTERM cancels it.

    Raises:
        Exception: of the work.
    """
    with asked_to_end() as stop:
        async with background(stop.wait(), work) as tasks:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        working = tasks[1]
        if not working.cancelled():
            working.result()
