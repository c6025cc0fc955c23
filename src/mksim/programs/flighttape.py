"""Records a flight in virtual time as the daemon's black box would: a recording that every program can read."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Final

from pydantic import BaseModel

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.daemon.blackbox import ImageRecorder
from mkdaemon.files import save
from mkdaemon.record.entry import Entry, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.tap import Tap
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.stamp import Stamp
from mksim.programs.sim_bus import truth_of
from mksim.programs.virtualports import LocalBus
from mksim.simulation import Simulation

ROOM: Final = 1 << 30
"""A flight of the demonstration takes a tenth of it [bytes]."""
TRUTH: Final = 0.05
"""Time between two true states [s]."""


class FlightTape:
    """Takes what passes in a flight; written to a file when it is over.

    Attributes:
        tap: for the line and the flight core.
        images: takes what the camera saw.
    """

    def __init__(self, cfg: Config, clock: Clock, bus: LocalBus) -> None:
        """Take everything that is put on a bus from now on.

        Args:
            cfg: of the daemon.
            clock: of the flight.
            bus: where its values are put.
        """
        self._base = TimeBase.of(clock.stamp())
        self._queue = EntryQueue(ROOM)
        self._cfg, self._clock = cfg, clock
        self._truth_at = 0.0
        self.tap = Tap(self._queue, clock, cfg.vehicle.name, self._base)
        self.images = ImageRecorder(cfg.record.images, self.tap, clock)
        bus.followers.append(self.take)

    def take(self, suffix: str, value: BaseModel) -> None:
        """Take a value that is published."""
        stamp = getattr(value, "stamp", None)
        carried = stamp if isinstance(stamp, Stamp) else None
        self.tap.sample(suffix, encode(value), encoding_of(type(value)), carried)

    def watch(self, simulation: Simulation) -> Callable[[float], None]:
        """What takes the true state after every step of the world."""

        def moved(now: float) -> None:
            if now >= self._truth_at:
                self._truth_at = now + TRUTH
                self.take("sim/truth", truth_of(simulation, self._clock.stamp(now), ""))

        return moved

    def write(self, path: Path) -> None:
        """Write the recording; what is there is replaced.

        Raises:
            MkError: it cannot be written.
        """
        config = self._cfg.model_dump_json(exclude={"sim"})
        name = self._cfg.vehicle.name
        session = Session.begin("demo", path.stem, self._base, vehicle=name, config=config)
        content = io.BytesIO()
        writer = RecordingWriter(content, session)
        for item in self._queue.take(len(self._queue)):
            entry = item if isinstance(item, Entry) else item()
            if entry is not None:
                writer.add(entry)
        writer.finish()
        save(path, content.getvalue(), overwrite=True)
