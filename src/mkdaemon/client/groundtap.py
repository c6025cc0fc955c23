"""The ground recorder: writes down what crosses the bus, of any number of vehicles, from a program of its own.

It sees what is put; requests and answers are between a client and the daemon, and it sees them as `event/command`.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import zenoh

from mkdaemon.clock import Clock
from mkdaemon.errors import ConfigError
from mkdaemon.record.countcheck import CountCheck
from mkdaemon.record.entry import ORDINARY, Congestion, Entry, Kind, Qos, TimeBase
from mkdaemon.record.queue import EntryQueue

EVERYTHING: Final = ("mk/**",)
"""What is recorded. A part of a key that begins with `@` is matched by no wildcard: such keys must be given in full."""
_SETPOINTS: Final = "setpoint/"


@dataclass
class VehicleTally:
    """What came of one vehicle.

    Attributes:
        received: values, its setpoints included.
        check: compares them with what its daemon counted.
    """

    received: int = 0
    check: CountCheck = field(default_factory=CountCheck)

    @property
    def lost(self) -> Counter[str]:
        """Values that its daemon put and that did not arrive, by key without `mk/<vehicle>/`."""
        return self.check.lost


class GroundTap:
    """Makes entries of what arrives. Called on Zenoh's threads, of several sessions if need be."""

    def __init__(self, queue: EntryQueue, clock: Clock, base: TimeBase) -> None:
        """Put entries into a queue.

        Args:
            queue: takes them.
            clock: of this machine.
            base: of the recording.
        """
        self.vehicles: dict[str, VehicleTally] = {}
        self._queue = queue
        self._clock = clock
        self._base = base
        self._sequences: Counter[tuple[Kind, str]] = Counter()
        self._lock = threading.Lock()

    def subscribe(self, session: zenoh.Session, expressions: Sequence[str] = EVERYTHING) -> None:
        """Take everything of some keys, until the session is closed.

        Raises:
            ConfigError: one of them is no key expression.
        """
        handler = zenoh.handlers.Callback(self._arrive, indirect=False)
        for expression in expressions:
            try:
                session.declare_subscriber(expression, handler)
            except zenoh.ZError as error:
                msg = f"{expression!r} is no key expression: {error}"
                raise ConfigError(msg) from error

    def take(
        self,
        key: str,
        payload: bytes,
        encoding: str,
        *,
        attachment: bytes = b"",
        qos: Qos = ORDINARY,
        source: str = "",
    ) -> None:
        """Take one value.

        Args:
            key: whole.
            payload: as it came.
            encoding: as it came.
            attachment: as it came.
            qos: as it was put.
            source: the session it says it comes from.
        """
        at = self._clock.now()
        vehicle, _, suffix = key.partition("/")[2].partition("/")
        kind = Kind.SETPOINT if suffix.startswith(_SETPOINTS) else Kind.SAMPLE
        with self._lock:
            self._sequences[kind, key] += 1
            wall = self._clock.stamp(at).wall
            sequence = self._sequences[kind, key]
            self._queue.put(
                Entry(kind, key, payload, encoding, at, wall, self._base, sequence, "", 0, attachment, qos, source)
            )
            self._tally(vehicle, suffix, payload)

    def _tally(self, vehicle: str, suffix: str, payload: bytes) -> None:
        tally = self.vehicles.setdefault(vehicle, VehicleTally())
        tally.received += 1
        tally.check.take(suffix, payload)

    def _arrive(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        attachment, info = sample.attachment, sample.source_info
        is_dropped = sample.congestion_control == zenoh.CongestionControl.DROP
        congestion = Congestion.DROP if is_dropped else Congestion.BLOCK
        qos = Qos(congestion, int(sample.priority), sample.express)  # type: ignore[call-overload]  # the stub errs
        self.take(
            str(sample.key_expr),
            sample.payload.to_bytes(),
            str(sample.encoding),
            attachment=b"" if attachment is None else attachment.to_bytes(),
            qos=ORDINARY if qos == ORDINARY else qos,
            source="" if info is None else str(info.source_id.zid),
        )


def with_carried_time(entry: Entry) -> Entry:
    """An entry whose publish time is that of the stamp in its payload, if it has one; for the writing thread."""
    return entry._replace(published=entry.stamp.wall)
