"""What is known about a flight afterwards: where its setpoints were late, and what the daemon said.

A setpoint has four times on one clock: the pilot puts it, the daemon has it, the daemon hands a stick frame to the
line, the boards hear that. Where the largest gap begins tells who was late: pilot, bus, daemon or line.
"""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from itertools import pairwise

from lab.rigs.pilot import Pilot
from lab.rigs.processes import ObservedSimulation, Sticks
from lab.rigs.waiting import following
from lab.stories.cable import first_words
from mkdaemon.client import Sample, Vehicle
from mkdaemon.protocol.framing import Frame, FrameDecoder


@dataclass(frozen=True, slots=True)
class Gaps:
    """Longest time between two setpoints of one flight on their way to the boards, the edges of the flight included.

    Attributes:
        put: by the pilot [s].
        received: by the daemon, of those it flew [s].
        sent: stick frames handed to the line [s].
        heard: stick frames that steer, by the boards [s].
    """

    put: float
    received: float
    sent: float
    heard: float


class FlightLog:
    """Listens to one flight.

    Attributes:
        said: events, verdicts about the line and losses of control, each with its time since the last `forget` [s].
    """

    def __init__(self, pilot: Pilot, simulation: ObservedSimulation) -> None:
        self._pilot, self._simulation = pilot, simulation
        self._began = time.monotonic()
        self._received: list[float] = []
        self._sent: list[float] = []
        self.said: list[str] = []
        self._sticks = Sticks.STEERED

    def forget(self) -> None:
        """Begin anew."""
        self._began, self._sticks = time.monotonic(), Sticks.STEERED
        for found in (self.said, self._received, self._sent, self._pilot.puts, self._simulation.heard):
            found.clear()

    def gaps(self) -> Gaps:
        """Return the gaps since the last `forget`."""
        now, decoder = time.monotonic(), FrameDecoder()
        heard = [at for at, data in self._simulation.heard if any(map(_steers, decoder.feed(data)))]

        def longest(times: Iterable[float]) -> float:
            edges = [self._began, *times, now]
            return round(max(after - before for before, after in pairwise(edges)), 3)

        return Gaps(longest(self._pilot.puts), longest(self._received), longest(self._sent), longest(heard))

    def note(self, sample: Sample) -> None:
        """Take what the daemon published."""
        fields = sample.fields
        if sample.suffix == "control/output":
            at = float(fields["stamp"]["monotonic"])
            self._sent.append(at)
            self._received.append(at - float(fields["age"]))
            return
        told = {name: value for name, value in fields.items() if name != "stamp" and value is not None}
        self.say(f"{sample.suffix} {told}")

    def say(self, text: str) -> None:
        """Take something else that is worth knowing, with its time."""
        self.said.append(f"{time.monotonic() - self._began:.3f} {text}")

    def look_at_boards(self) -> bool:
        """Whether the aircraft is steered now; what became of its sticks is said when it changes."""
        sticks = self._simulation.sticks
        if sticks is not self._sticks:
            self._sticks = sticks
            self.say(f"the boards hold {sticks.value}")
        return sticks is Sticks.STEERED


def _steers(item: object) -> bool:
    """Whether something decoded is a stick frame and no release."""
    return isinstance(item, Frame) and item.id == "b" and first_words(item.raw) != "release"


@asynccontextmanager
async def flight_log(client: Vehicle, pilot: Pilot, simulation: ObservedSimulation) -> AsyncIterator[FlightLog]:
    """Listen for as long as the context lasts."""
    log = FlightLog(pilot, simulation)
    async with following(client, log.note, "control/output", "event/*", "link/state"):
        yield log
