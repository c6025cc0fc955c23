"""The aircraft at the end of the daemon's line, with every frame that crosses it, and what its memory took."""

from __future__ import annotations

from collections import Counter
from typing import Final

from lab.hil.aircraft import GenuineAircraft
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mksim.physics.world import World
from mksim.programs.rehearsal import FlyingAircraft

STICKS: Final = "b"
"""The letter of a stick frame; every other letter is a request."""
LINK_TEST: Final = "v"


class Tap:
    """The aircraft, and every frame that crosses its line while `is_counting`.

    Attributes:
        aircraft: behind it.
        now: simulated time [s].
        is_counting: frames count from here on.
        sent: frames written by the daemon, by letter.
        heard: frames of the board that reached the daemon, by letter.
        taken: frames that the firmware's receive buffer took, by letter.
        obeyed: stick frames that external control held once they were handled.
        waits: how long each frame stayed in the receive buffer [s].
    """

    def __init__(self, aircraft: FlyingAircraft) -> None:
        self.aircraft, self.now = aircraft, aircraft.now
        self.is_counting = False
        self.sent, self.heard = Counter[str](), Counter[str]()
        self.taken, self.obeyed = Counter[str](), 0
        self.waits = list[float]()
        self._out, self._in = FrameDecoder(), FrameDecoder()
        if isinstance(aircraft, GenuineAircraft):
            aircraft.world.watch_frames()

    @property
    def world(self) -> World:
        """Airframe, air, pilot and faults."""
        return self.aircraft.world

    def write(self, data: bytes, at: float) -> None:
        """Bytes of the daemon."""
        self._count(self.sent, self._out, data)
        self.aircraft.write(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run on; see `FlyingAircraft`."""
        said = self.aircraft.advance(to)
        self.now = to
        self._count(self.heard, self._in, b"".join(data for _, data in said))
        if isinstance(self.aircraft, GenuineAircraft):
            self._look_into_memory(self.aircraft)
        return said

    def _count(self, counts: Counter[str], decoder: FrameDecoder, data: bytes) -> None:
        for found in decoder.feed(data):
            if isinstance(found, Frame) and self.is_counting:
                counts[found.id] += 1

    def _look_into_memory(self, aircraft: GenuineAircraft) -> None:
        for taken in aircraft.world.chip.taken():
            frames = [found for found in FrameDecoder().feed(taken.frame) if isinstance(found, Frame)]
            if not frames or not self.is_counting:
                continue
            self.taken[frames[0].id] += 1
            self.waits.append(taken.done - taken.at)
            size = aircraft.world.control_size
            self.obeyed += frames[0].id == STICKS and taken.held[:size] == frames[0].payload[:size]
