"""The ground recorder: records the bus of any number of vehicles, in a separate program.

It sees what is put; requests and answers are between a client and the daemon, and it sees them as `event/command`.
"""

from __future__ import annotations

import asyncio
import threading
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import zenoh

from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.names import received_vehicle
from mkdaemon.bus.schema import schema_json
from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.client.taskerrors import beside
from mkdaemon.clock import Clock
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.record.countcheck import CountCheck
from mkdaemon.record.entry import ORDINARY, Congestion, Entry, EntryKind, Qos, TimeBase
from mkdaemon.record.folder import RecordingFolder, RoomLimits, recording_name
from mkdaemon.record.layout import Session
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.recorder import Recorder, RecorderReport, RecorderThread
from mkdaemon.record.view import JsonView

EVERYTHING: Final = ("mk/**",)
"""What is recorded. A part of a key that begins with `@` is matched by no wildcard: such keys must be given in full."""
SIMULATED_IMAGES: Final = "sim/camera/"
"""What a simulated camera sees, 9 MB/s: recorded only where a key expression names it; `vision/` is recorded."""
_SETPOINTS: Final = "setpoint/"


PREFIX: Final = "ground"
RETRY: Final = 1.0
"""Time before a daemon that does not answer is tried again [s]."""
CLOSING: Final = 10.0
"""Longest time to write what is left at the end [s]."""


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
    """Makes entries of what arrives. Called on Zenoh's threads, of several sessions if need be.

    Attributes:
        vehicles: what came of each.
        dropped: what arrived and is not a value of a key: put to a wildcard, or a deletion.
    """

    def __init__(self, queue: EntryQueue, clock: Clock, base: TimeBase) -> None:
        """Put entries into a queue.

        Args:
            queue: takes them.
            clock: of this machine.
            base: of the recording.
        """
        self.vehicles: dict[str, VehicleTally] = {}
        self.dropped = 0
        self._queue = queue
        self._clock = clock
        self._base = base
        self._sequences: Counter[tuple[EntryKind, str]] = Counter()
        self._lock = threading.Lock()

    def subscribe(self, session: zenoh.Session, expressions: Sequence[str] = EVERYTHING) -> None:
        """Take everything of some keys until the session is closed; of a simulated camera only what is named.

        Raises:
            ConfigError: one of them is not a key expression.
        """
        for expression in expressions:
            arrive = self._arrive if SIMULATED_IMAGES in expression else self._arrive_without_images
            try:
                session.declare_subscriber(expression, direct(arrive, self._drop))
            except zenoh.ZError as error:
                raise ConfigError(f"{expression!r} is not a key expression: {error}") from error

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
        kind = EntryKind.SETPOINT if suffix.startswith(_SETPOINTS) else EntryKind.SAMPLE
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

    def _drop(self) -> None:
        with self._lock:
            self.dropped += 1

    def _arrive_without_images(self, sample: zenoh.Sample) -> None:
        if SIMULATED_IMAGES not in str(sample.key_expr):
            self._arrive(sample)

    def _arrive(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT or received_vehicle(str(sample.key_expr)) is None:
            self._drop()
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


@dataclass(frozen=True, slots=True)
class GroundPlan:
    """What is recorded, and where.

    Attributes:
        endpoints: of daemons or routers.
        folder: of the files.
        limits: how much room they may take.
        expressions: key expressions that are recorded.
        zenoh_file: Zenoh configuration, for TLS.
        queue_bytes: limit of data that waits for a slow disk [bytes].
        sync_period: time between two moments at which the file is brought to the disk itself [s]; 0 for never.
        has_json: whether JSON for viewers is added.
    """

    endpoints: Sequence[str]
    folder: Path
    limits: RoomLimits
    expressions: Sequence[str] = EVERYTHING
    zenoh_file: Path | None = None
    queue_bytes: int = 64_000_000
    sync_period: float = 5.0
    has_json: bool = True


class GroundRecording:
    """A recording that is being made.

    Attributes:
        tap: counts what came.
        queue: what waits to be written.
        connected: endpoints that have answered.
    """

    def __init__(self, plan: GroundPlan, clock: Clock) -> None:
        stamp = clock.stamp()
        base = TimeBase.of(stamp)
        self.queue = EntryQueue(plan.queue_bytes)
        self.tap = GroundTap(self.queue, clock, base)
        self.connected: list[str] = []
        session = Session.begin("ground", recording_name(PREFIX, stamp.wall), base)
        recorder = Recorder(
            self.queue,
            RecordingFolder(plan.folder, PREFIX, plan.limits),
            session,
            view=JsonView(schema_json) if plan.has_json else None,
            sync_period=plan.sync_period,
            complete=with_carried_time,
        )
        self.thread = RecorderThread(recorder)

    @property
    def report(self) -> RecorderReport:
        """What the recorder does now."""
        return self.thread.report

    @property
    def received(self) -> int:
        """Values that came."""
        return sum(tally.received for tally in self.tap.vehicles.values())

    @property
    def lost_on_the_way(self) -> int:
        """Values that daemons put and that did not arrive."""
        return sum(tally.lost.total() for tally in self.tap.vehicles.values())


@asynccontextmanager
async def record_ground(plan: GroundPlan) -> AsyncIterator[GroundRecording]:
    """Record while the context lasts; then write what is left and end the file.

    A daemon that does not answer is tried again for ever; one that comes back is connected again by Zenoh.

    Raises:
        ConfigError: an endpoint, the Zenoh file or a key expression is wrong.
        MkError: what was left could not be written at the end.
    """
    recording = GroundRecording(plan, Clock())
    for endpoint in plan.endpoints:
        session_config("client", connect=[endpoint], zenoh_file=plan.zenoh_file)  # fails before the recorder starts
    recording.thread.start()
    try:
        async with (
            AsyncExitStack() as sessions,
            beside(*(_connect(recording, plan, one, sessions) for one in plan.endpoints)),
        ):
            yield recording
    finally:
        is_done = await asyncio.to_thread(recording.thread.stop, CLOSING)
    if not is_done:
        raise MkError(f"{plan.folder}: the disk accepted no data for {CLOSING:g} s; what was flushed is in the file")


async def _connect(recording: GroundRecording, plan: GroundPlan, endpoint: str, sessions: AsyncExitStack) -> None:
    config = session_config("client", connect=[endpoint], zenoh_file=plan.zenoh_file)
    while True:
        try:
            session = await open_session(config)
        except ConfigError:
            raise
        except MkError:
            await asyncio.sleep(RETRY)
            continue
        sessions.push_async_callback(close_session, session)
        recording.tap.subscribe(session, plan.expressions)
        recording.connected.append(endpoint)
        return
