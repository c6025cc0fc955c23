"""A recording made on the ground: sessions with one daemon or several, and a thread that writes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mkdaemon.bus.schema import schema_json
from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.client.groundtap import EVERYTHING, GroundTap, with_carried_time
from mkdaemon.clock import Clock
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.record.entry import TimeBase
from mkdaemon.record.folder import Limits, RecordingFolder, recording_name
from mkdaemon.record.layout import Session
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.recorder import Recorder, RecorderReport, RecorderThread
from mkdaemon.record.view import JsonView

PREFIX: Final = "ground"
RETRY: Final = 1.0
"""Time before a daemon that does not answer is tried again [s]."""
CLOSING: Final = 10.0
"""Longest time to write what is left at the end [s]."""


@dataclass(frozen=True, slots=True)
class GroundPlan:
    """What is recorded, and where.

    Attributes:
        endpoints: of daemons or routers.
        folder: of the files.
        limits: how much room they may take.
        expressions: key expressions that are recorded.
        zenoh_file: Zenoh configuration, for TLS.
        queue_bytes: so much may wait for a slow disk [bytes].
        sync_period: time between two moments at which the file is brought to the disk itself [s]; 0 for never.
        has_json: whether JSON for viewers is added.
    """

    endpoints: Sequence[str]
    folder: Path
    limits: Limits
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
        session_config("client", connect=[endpoint], zenoh_file=plan.zenoh_file)  # what is wrong is told at once
    recording.thread.start()
    try:
        async with AsyncExitStack() as sessions, asyncio.TaskGroup() as tasks:
            connecting = [tasks.create_task(_connect(recording, plan, one, sessions)) for one in plan.endpoints]
            yield recording
            for task in connecting:
                task.cancel()
    except BaseExceptionGroup as group:
        mistakes, others = group.split(ConfigError)
        if mistakes is None or others is not None:
            raise
        raise mistakes.exceptions[0] from None
    finally:
        is_done = await asyncio.to_thread(recording.thread.stop, CLOSING)
    if not is_done:
        msg = f"{plan.folder}: the disk took nothing for {CLOSING:g} s; what was flushed is in the file"
        raise MkError(msg)


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
