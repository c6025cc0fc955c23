"""Programs that go on until they are asked to end."""

from __future__ import annotations

import asyncio
import signal


async def until_asked_to_end() -> None:
    """Wait for Ctrl-C or SIGTERM: the program ends in order, with exit code 0."""
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    ends = (signal.SIGINT, signal.SIGTERM)
    for name in ends:
        loop.add_signal_handler(name, stop.set)
    try:
        await stop.wait()
    finally:
        for name in ends:
            loop.remove_signal_handler(name)
