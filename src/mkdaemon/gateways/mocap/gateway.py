"""Reads a motion capture system and reports each configured body to its vehicle."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from mkdaemon.client.positions import PositionSender
from mkdaemon.clock import Clock
from mkdaemon.errors import ConfigError
from mkdaemon.gateways.mocap.systems import BodyPose, Frames
from mkdaemon.telemetry.position import PositionHealth

HEALTH: Final = 1.0
"""Time between two words about itself [s]."""
RETRIES: Final = (0.5, 1.0, 2.0, 5.0)
"""Times between two attempts to connect; the last is repeated [s]."""
UNKNOWN_AFTER: Final = 3.0
"""A body that no measurement shows for longer is named, with those that are seen [s]."""

Show = Callable[[str], None]
"""Prints a line of progress."""


@dataclass(slots=True)
class Body:
    """A body and where it is reported.

    Attributes:
        name: in the system.
        source: name of the source, as the vehicle's `[[positions]]` has it.
        sender: puts its reports.
        lost: measurements without it.
        seen_at: when it was seen last [s].
        last: its last pose: the same numbers again are no measurement.
    """

    name: str
    source: str
    sender: PositionSender
    lost: int = 0
    seen_at: float = float("-inf")
    last: BodyPose | None = None


class MocapGateway:
    """One system and the bodies that are reported.

    Attributes:
        reconnections: how often the system had to be reached again.
    """

    def __init__(
        self,
        where: str,
        connect: Frames,
        bodies: Sequence[Body],
        latency: float,
        show: Show,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare.

        Args:
            where: kind and address of the system, in words.
            connect: connects to it.
            bodies: what is reported.
            latency: from a measurement until it arrives here [s]; the library does not say it.
            show: prints progress.
            clock: [s].
        """
        self._where, self._connect, self._bodies, self._latency = where, connect, tuple(bodies), latency
        self._show, self._clock = show, clock
        self._frames: deque[float] = deque(maxlen=1000)
        self._sent: Mapping[str, deque[float]] = {body.name: deque(maxlen=1000) for body in bodies}
        self._seen: tuple[str, ...] = ()
        self._began = clock()
        self._trouble = self._shown = "connecting"
        self._complained: set[str] = set()
        self.reconnections = 0
        self._ends = threading.Event()
        self._mistake: ConfigError | None = None

    def measured(self, bodies: Mapping[str, BodyPose]) -> None:
        """Report what one measurement shows; a body that it does not show is not reported."""
        now = self._clock()
        self._trouble, self._seen = "", tuple(sorted(bodies))
        self._frames.append(now)
        for body in self._bodies:
            pose = bodies.get(body.name)
            if pose is None or pose == body.last:
                body.lost += 1
                continue
            body.last, body.seen_at = pose, now
            self._sent[body.name].append(now)
            body.sender.send(pose.position, pose.quaternion, age=self._latency)

    def health_of(self, body: Body, clock: Clock) -> PositionHealth:
        """What is said of a body now."""
        now = self._clock()
        return PositionHealth(
            stamp=clock.stamp(),
            source=body.source,
            system=self._where,
            body=body.name,
            rate=float(sum(at > now - HEALTH for at in self._sent[body.name])),
            frames=float(sum(at > now - HEALTH for at in self._frames)),
            lost=body.lost,
            reconnections=self.reconnections,
            seen=self._seen,
            reason=self._why(body, now),
        )

    def _why(self, body: Body, now: float) -> str:
        """Why a body is not reported; empty while it is."""
        if self._trouble or not self._frames or self._frames[-1] < now - HEALTH:
            return self._trouble or f"{self._where} sends nothing: is it measuring, and does it stream?"
        if now - max(body.seen_at, self._began) <= UNKNOWN_AFTER:
            return ""
        seen = ", ".join(self._seen) or "none"
        return f"body {body.name!r} is not seen; bodies that are: {seen}"

    async def run(self) -> None:
        """Read in a separate thread, and say how it goes once a second, until it is cancelled.

        Raises:
            ConfigError: the library does not know the kind of system.
        """
        thread = threading.Thread(target=self._read, name="motion capture", daemon=True)
        thread.start()
        clock = Clock()
        try:
            while True:
                await asyncio.sleep(HEALTH)
                for body in self._bodies:
                    health = self.health_of(body, clock)
                    body.sender.publish_health(health)
                    self._complain(body.name, health.reason)
                if self._mistake is not None:
                    raise self._mistake
        finally:
            self._ends.set()

    def _complain(self, name: str, reason: str) -> None:
        """Print why nothing is sent, once, unless the thread that reads has; and that it is again."""
        if reason and name not in self._complained and reason != self._shown:
            self._show(reason)
        elif not reason and name in self._complained:
            self._show(f"body {name!r} is reported")
        self._complained = self._complained | {name} if reason else self._complained - {name}

    def _read(self) -> None:
        """Connect and read for ever; a system that is lost is reached again."""
        attempt = 0
        while not self._ends.is_set():
            try:
                for bodies in self._connect():
                    attempt = 0
                    if self._ends.is_set():
                        return
                    self.measured(bodies)
                self._shown = self._trouble = f"{self._where} has ended"
            except ConfigError as error:
                self._mistake = error
                return
            except (RuntimeError, OSError, ValueError) as error:
                self._shown = self._trouble = f"{self._where}: {error}"
            if self._ends.is_set():
                return
            wait = RETRIES[min(attempt, len(RETRIES) - 1)]
            attempt, self.reconnections = attempt + 1, self.reconnections + 1
            self._show(f"{self._shown}; next attempt in {wait:g} s")
            self._ends.wait(wait)
