"""Cameras, where the configuration has any: one worker thread that looks, and the attitude it looks with."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from typing import TYPE_CHECKING

import structlog

from mkdaemon.bus.gateway import Bus
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.events import EyeStats, Feed, PoseSeen, SightRefused
from mkdaemon.daemon.audit import Outlet
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.state import Altitude, Attitude
from mkdaemon.telemetry.vision import PoseRefused, VisionPose, VisionStats

if TYPE_CHECKING:
    from mkdaemon.vision.camera.image import CameraImage
    from mkdaemon.vision.track.attitude import AttitudeHistory
    from mkdaemon.vision.worker import VisionWorker

_log = structlog.get_logger(__name__)
RecordImage = Callable[["CameraImage", "AttitudeHistory"], None]
"""Takes an image for a recording, and the attitude it is looked at with."""


class Eyes:
    """The cameras of the vehicle, or none."""

    def __init__(self, worker: VisionWorker | None) -> None:
        self._worker = worker

    @asynccontextmanager
    async def open(self) -> AsyncIterator[None]:
        """Look for as long as the context lasts; closing waits for the threads without holding up the loop."""
        if self._worker is None:
            yield
            return
        self._worker.start()
        supervision = asyncio.create_task(self._worker.supervise(), name="vision")
        supervision.add_done_callback(_log_defect)
        try:
            yield
        finally:
            supervision.cancel()
            await asyncio.to_thread(self._worker.stop, CLOSING)

    def attitude_received(self, attitude: Attitude) -> None:
        """Give vision the attitude, so that it can refuse a pose that contradicts it."""
        if self._worker is None:
            return
        from mkdaemon.vision.track.attitude import AttitudeSample

        sample = AttitudeSample(attitude.stamp.monotonic, attitude.roll, attitude.pitch, attitude.yaw)
        self._worker.attitude_arrived(sample)

    def altitude_received(self, altitude: Altitude) -> None:
        """Give vision the barometer's height, to compare with its own."""
        if self._worker is not None:
            self._worker.barometer_arrived(altitude.stamp.monotonic, altitude.above_start)


class PoseSink:
    """Takes what the cameras see and say of themselves: it reaches the flight core before the bus."""

    def __init__(self, feed: Feed, bus: Outlet, clock: Clock) -> None:
        self._feed = feed
        self._clock = clock
        self._bus = bus

    def publish(self, suffix: str, value: Telemetry) -> None:
        """Hand a value on; see `Bus.publish`."""
        if isinstance(value, VisionPose):
            self._feed(PoseSeen(value), self._clock.now())
        elif isinstance(value, PoseRefused):
            self._feed(SightRefused(value), self._clock.now())
        elif isinstance(value, VisionStats):
            self._feed(EyeStats(value), self._clock.now())
        self._bus.publish(suffix, value)


CLOSING = 1.0
"""Longest time cameras get to close [s]; the whole daemon must be gone within two."""


def open_eyes(
    cfg: Config, bus: Bus, clock: Clock, feed: Feed, record: RecordImage = lambda image, attitude: None
) -> Eyes:
    """Prepare the cameras, whose poses go to the flight core first; a daemon without any never loads OpenCV.

    Args:
        cfg: all of it.
        bus: where values go.
        clock: stamps.
        feed: passes poses to the flight core.
        record: takes every image on the vision thread, and returns at once.

    Raises:
        ConfigError: a source, camera file or target file is wrong.
    """
    if not cfg.cameras:
        return Eyes(None)
    from mkdaemon.vision.camera.sources import source_of
    from mkdaemon.vision.worker import VisionWorker

    loop = asyncio.get_running_loop()
    sink = PoseSink(feed, bus, clock)
    source = partial(source_of, session=lambda: bus.session)
    worker = VisionWorker(cfg.cameras, cfg.vision, sink.publish, loop, clock, open_source=source, record=record)
    return Eyes(worker)


def _log_defect(supervision: asyncio.Task[None]) -> None:
    """A defect in looking after the cameras ends no flight, but must not pass unseen."""
    if not supervision.cancelled() and (error := supervision.exception()) is not None:
        _log.error("the supervision of the cameras has failed", exc_info=error)
