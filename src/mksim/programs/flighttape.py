"""Records a flight in virtual time: what is put on its bus, and the true state, as a recording that programs read."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

from pydantic import BaseModel

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.clock import Clock
from mkdaemon.config.vehicle import VehicleConfig
from mkdaemon.files import save
from mkdaemon.record.entry import Entry, EntryKind, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.stamp import Stamp
from mksim.programs.sim_bus import truth_of
from mksim.simulation import Simulation

TRUTH: Final = 0.05
"""Time between two true states [s]."""
IMAGES: Final = 0.5
"""Time between two images [s], as the black box keeps them."""
VEHICLE: Final = VehicleConfig().name


class FlightTape:
    """Takes what is published in a flight; written to a file when it is over."""

    def __init__(self) -> None:
        self._entries: list[Entry] = []
        self._counts: Counter[str] = Counter()
        self._clock: Clock | None = None
        self._base = TimeBase("", 0)
        self._truth_at = self._image_at = float("-inf")

    def begin(self, clock: Clock) -> None:
        """Take everything from now on.

        Args:
            clock: of the flight.
        """
        self._clock, self._base = clock, TimeBase.of(clock.stamp())

    def take(self, suffix: str, value: BaseModel) -> None:
        """Take a value that is published."""
        if self._clock is None:
            return
        now = self._clock.now()
        if suffix.endswith("/image"):
            if now < self._image_at:
                return
            self._image_at = now + IMAGES
        stamp = getattr(value, "stamp", None)
        wall = (stamp if isinstance(stamp, Stamp) else self._clock.stamp(now)).wall
        self._counts[suffix] += 1
        payload, encoding, number = encode(value), encoding_of(type(value)), self._counts[suffix]
        key = f"mk/{VEHICLE}/{suffix}"
        self._entries.append(Entry(EntryKind.SAMPLE, key, payload, encoding, now, wall, self._base, number))

    def follow(self, simulation: Simulation) -> Callable[[float], None]:
        """What takes the true state: to be called after every step of the world with the time [s]."""

        def moved(now: float) -> None:
            if self._clock is not None and now >= self._truth_at:
                self._truth_at = now + TRUTH
                self.take("sim/truth", truth_of(simulation, self._clock.stamp(now)))

        return moved

    def write(self, path: Path) -> None:
        """Write the recording; what is there is replaced.

        Raises:
            ConfigError: there is no such folder.
            MkError: it cannot be written.
        """
        content = io.BytesIO()
        writer = RecordingWriter(content, Session.begin("demo", path.stem, self._base, vehicle=VEHICLE))
        for entry in self._entries:
            writer.add(entry)
        writer.finish()
        save(path, content.getvalue(), overwrite=True)
