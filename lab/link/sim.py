"""The simulator as a process of its own for `python -m lab link`, which tells what really happened on its side.

    python -m lab.link.sim '{"board": "nc", ...}'

prints `{"port": ...}`, and when its standard input ends one more object: for every link test when its bytes came and
when the last byte of its answer left (the wire and the board lie between), frames counted, packets of the radio.
"""

from __future__ import annotations

import asyncio
import gc
import json
import sys
import time
from collections import Counter
from typing import Final

from mkdaemon.protocol.framing import Frame, FrameDecoder
from mksim.config import SimConfig
from mksim.physics.world import World
from mksim.radio import RadioChannel
from mksim.runtime import Runtime
from mksim.simulation import Simulation

PROBES: Final = {"z": "Z", "v": "V"}
"""Link tests and their answers."""


class Witness(Simulation):
    """A simulation that notes when bytes come and go.

    Attributes:
        trips: (came, left) of every answered link test [s; monotonic].
        came: frames from the host by letter.
        left: frames to the host by letter.
        delivered: frames that reached the board by letter: what line and radio left of `came`.
    """

    def __init__(self, config: SimConfig, world: World | None = None) -> None:
        super().__init__(config, world)
        self.trips: list[tuple[float, float]] = []
        self.came: Counter[str] = Counter()
        self.left: Counter[str] = Counter()
        self.delivered: Counter[str] = Counter()
        self._asked: dict[str, float] = {}
        self._at_board = FrameDecoder()
        self._board_takes = self.port.receive_byte
        self.port.receive_byte = self._deliver  # type: ignore[method-assign]
        self._inward, self._outward = FrameDecoder(), FrameDecoder()

    def _deliver(self, byte: int, at: float) -> None:
        """Count what reaches the board."""
        for item in self._at_board.feed(bytes((byte,))):
            if isinstance(item, Frame):
                self.delivered[item.id] += 1
        self._board_takes(byte, at)

    def write(self, data: bytes, at: float) -> None:
        """Take bytes of the host."""
        now = time.monotonic()
        for item in self._inward.feed(data):
            if isinstance(item, Frame):
                self.came[item.id] += 1
                if item.id in PROBES:
                    self._asked[PROBES[item.id]] = now
        super().write(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run, and note what reaches the host."""
        arrived = super().advance(to)
        if arrived:
            now = time.monotonic()
            for item in self._outward.feed(b"".join(data for _, data in arrived)):
                if isinstance(item, Frame):
                    self.left[item.id] += 1
                    asked = self._asked.pop(item.id, None)
                    if asked is not None:
                        self.trips.append((asked, now))
        return arrived

    def channels(self) -> tuple[RadioChannel, RadioChannel]:
        """Both directions of the line."""
        return self._to_board, self._to_host


async def serve(config: SimConfig) -> None:
    """Offer the port until standard input ends, then report."""
    witness = Witness(config)
    async with Runtime(witness).serve() as runtime:
        print(json.dumps({"port": runtime.port}), flush=True)
        loop = asyncio.get_running_loop()
        reader = asyncio.StreamReader()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        await reader.read()
        up, down = witness.channels()
        report = {
            "trips": witness.trips,
            "came": witness.came,
            "left": witness.left,
            "delivered": witness.delivered,
            "packets": [up.packets, down.packets],
            "packets_lost": [up.packets_lost, down.packets_lost],
            "unread": runtime.lost,
        }
        print(json.dumps(report), flush=True)


if __name__ == "__main__":
    gc.freeze()
    asyncio.run(serve(SimConfig.model_validate_json(sys.argv[1])))
