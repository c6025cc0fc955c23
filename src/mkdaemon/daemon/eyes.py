"""Cameras, where the configuration has any: one worker thread that looks, and the attitude it looks with."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from mkdaemon.bus.gateway import Bus
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.telemetry.state import Attitude

if TYPE_CHECKING:
    from mkdaemon.vision.worker import VisionWorker


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
        try:
            yield
        finally:
            await asyncio.to_thread(self._worker.stop, CLOSING)

    def attitude_said(self, attitude: Attitude) -> None:
        """Tell the eyes how the vehicle lies, so that a pose that contradicts it can be refused."""
        if self._worker is None:
            return
        from mkdaemon.vision.track.attitude import AttitudeSample

        sample = AttitudeSample(attitude.stamp.monotonic, attitude.roll, attitude.pitch, attitude.yaw)
        self._worker.attitude_arrived(sample)


CLOSING = 1.0
"""Longest time cameras get to close [s]; the whole daemon must be gone within two."""


def open_eyes(cfg: Config, bus: Bus, clock: Clock) -> Eyes:
    """Prepare the cameras; a daemon without any never loads OpenCV.

    Raises:
        ConfigError: a source, camera file or target file is wrong.
    """
    if not cfg.cameras:
        return Eyes(None)
    from mkdaemon.vision.worker import VisionWorker

    loop = asyncio.get_running_loop()
    return Eyes(VisionWorker(cfg.cameras, cfg.vision, bus, loop, clock, session=lambda: bus.session))
