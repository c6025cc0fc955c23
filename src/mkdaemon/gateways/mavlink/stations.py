"""A ground station as the gateway meets it: what it hears, how often, and whether it is still there."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from mkdaemon.gateways.mavlink.dialect import BROADCAST, Message
from mkdaemon.gateways.mavlink.framing import Encoder
from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.gateways.mavlink.telemetry import TABLE

SILENCE: Final = 2.5
"""A station is gone this time after its last heartbeat [s]; it sends one a second."""
FORGOTTEN: Final = 30.0
"""Streams to a station end this time after its last message [s]."""
_MOST_PROGRAMS: Final = 16
"""Programs, by system and component, behind one address; a further one waits until one of them is silent."""
_EARLY: Final = 0.2
"""A value that comes by this share of the period before it is due is sent: sources are not that regular."""


class Program(NamedTuple):
    """Who sent a message."""

    system: int
    component: int


class Station:
    """An address where a ground station is, or several behind a router.

    Attributes:
        numbering: whose numbers the modes have.
        name: for people.
        is_open: whether its connection stands.
        dropped: messages that it was too slow to take.
        refused: messages of programs that were one too many.
        received_at: when something last came from there, or it was met [s].
    """

    def __init__(
        self,
        name: str,
        numbering: Numbering,
        encoder: Encoder,
        put: Callable[[bytes], bool],
        wall: Callable[[], float],
    ) -> None:
        """Describe a station.

        Args:
            name: for people.
            numbering: of its modes.
            encoder: numbers and signs what is sent.
            put: hands bytes over, from any thread; says whether they were taken.
            wall: the system clock [s].
        """
        self.name, self.numbering = name, numbering
        self.is_open = True
        self.dropped = self.refused = 0
        self.received_at = -math.inf
        self.wish_for: dict[str, float] = {}
        self._encoder, self._put, self._wall = encoder, put, wall
        self._sending = threading.Lock()  # messages leave in the order of their numbers, whichever thread sends them
        self._received: dict[Program, float] = {}
        self._due: dict[str, float] = {}
        self._beaten: dict[Program, float] = {}

    def send(self, message: Message) -> None:
        """Send a message, from any thread; a station that is too slow loses it."""
        with self._sending:
            if self.is_open and not self._put(self._encoder.encode(message, self._wall())):
                self.dropped += 1

    def note_message(self, program: Program, now: float, *, is_heartbeat: bool) -> bool:
        """Note that something came from a program there; whether its message is taken.

        A program that still speaks is never forgotten for another one: it may be the one that flies.
        """
        if program not in self._received and len(self._received) >= _MOST_PROGRAMS:
            oldest = min(self._received, key=self._received.__getitem__)
            if now - self._received[oldest] < SILENCE:
                self.refused += 1
                return False
            del self._received[oldest]
            self._beaten.pop(oldest, None)
        self._received[program] = self.received_at = now
        if is_heartbeat:
            self._beaten[program] = now
        return True

    def forget(self) -> None:
        """Forget every program behind the address, which makes room for another one."""
        self.received_at = -math.inf
        self._received.clear()
        self._beaten.clear()
        self.wish_for.clear()

    def is_present(self, now: float) -> bool:
        """Whether a program is connected, so that streams are sent."""
        return self.is_open and any(now - at < FORGOTTEN for at in tuple(self._received.values()))

    def is_alive(self, program: Program, now: float) -> bool:
        """Whether a program there is still beating; one that never did counts by what else it sends."""
        at = self._beaten.get(program, self._received.get(program))
        return self.is_open and at is not None and now - at < SILENCE

    def interval(self, name: str) -> float:
        """Period with which a message is sent here [s]; 0 for never."""
        wish = self.wish_for.get(name)
        if wish is not None:
            return wish
        rate = TABLE[name].rate
        return 1.0 / rate if rate else 0.0

    def is_due(self, name: str, now: float) -> bool:
        """Whether a message is to be sent here now, and count that it is."""
        interval = self.interval(name)
        due = self._due.get(name, 0.0)
        if interval <= 0.0 or now < due - _EARLY * interval:
            return False
        self._due[name] = max(due + interval, now)
        return True

    def ask(self, name: str, interval: float) -> None:
        """Send a message with another period from now on [s]; 0 for never."""
        self.wish_for[name] = interval
        self._due.pop(name, None)


@dataclass(frozen=True, slots=True)
class By:
    """Sender of a message, and receiver of its answer: a program at a station.

    Attributes:
        station: where.
        program: which one there.
    """

    station: Station
    program: Program

    def is_alive(self, now: float) -> bool:
        """Whether it is still there."""
        return self.station.is_alive(self.program, now)

    def send(self, message: Message) -> None:
        """Send it a message; see `Station.send`."""
        self.station.send(message)

    def __str__(self) -> str:
        return f"ground station {self.program.system}/{self.program.component}"


Take = Callable[[By, Message], Coroutine[Any, Any, None] | None]
"""Takes a message, at once or by work that is done beside everything else."""


def is_for(message: Message, system: int, component: int) -> bool:
    """Whether a message is for us or a broadcast; a message without a target is a broadcast.

    Args:
        message: as it came.
        system: ours.
        component: ours.
    """
    target = getattr(message, "target_system", BROADCAST)
    part = getattr(message, "target_component", BROADCAST)
    return target in (BROADCAST, system) and part in (BROADCAST, component)
