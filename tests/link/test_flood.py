"""More bytes than any line carries: everything is decoded, and nobody else waits for it."""

from __future__ import annotations

import asyncio

from lab.rigs.linkrig import Log, virtually
from lab.rigs.waiting import running
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.link.session.exchange import TURN_BYTES
from mkdaemon.protocol.framing import encode_frame

FRAMES = 2_000
SHORTEST = 6


class FloodedPort:
    """A port on which thousands of valid frames arrive at once."""

    name, backlog, descriptor, is_recording = "flood", 0, None, False

    def __init__(self, frames):
        self._chunks = [encode_frame(2, "Q") * frames]

    async def read(self):
        if self._chunks:
            return self._chunks.pop()
        await asyncio.Event().wait()
        return b""

    def write(self, data):
        pass

    def discard(self):
        pass

    async def drain(self):
        pass

    async def close(self):
        pass


@virtually
async def test_a_flood_of_valid_frames_leaves_every_turn_of_the_loop_to_others():
    log, most, turns = Log(), 0, 0

    async def open_flooded(url, *, baud):
        return FloodedPort(FRAMES)

    clock = Clock(monotonic=asyncio.get_running_loop().time)
    link = Link(LinkConfig(port="/dev/flood"), log, opener=open_flooded, clock=clock, motors_running=lambda now: None)
    async with running(link.run(discover)):
        while len(log.rx) < FRAMES:
            before = len(log.rx)
            await asyncio.sleep(0)
            most, turns = max(most, len(log.rx) - before), turns + 1
    assert most <= TURN_BYTES // SHORTEST + 1
    assert turns >= FRAMES * SHORTEST / TURN_BYTES
