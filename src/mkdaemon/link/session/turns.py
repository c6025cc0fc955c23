"""Bytes in portions, so that a flood on the line holds nobody else up."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Final

TURN_BYTES: Final = 256
"""Bytes decoded in one turn of the loop: 45 ms of the line at 57600 baud, and 42 frames at most: the shortest has 6."""


async def in_turns(chunk: bytes) -> AsyncIterator[bytes]:
    """Yield what arrived in portions; setpoints and requests have their turn between two."""
    for start in range(0, len(chunk), TURN_BYTES):
        if start:
            await asyncio.sleep(0)
        yield chunk[start : start + TURN_BYTES]
