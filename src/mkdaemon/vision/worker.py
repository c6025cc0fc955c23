"""All cameras through one worker thread; results go to the event loop, which they never hold up."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

import cv2
import zenoh

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.errors import ConfigError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.vision import Alarm, EyeState
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.camera.shot import Source
from mkdaemon.vision.camera.slot import NewestSlot, NewestSlots
from mkdaemon.vision.camera.sources import source_of
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample

STATS_EVERY = 1.0
LOOK_EVERY = 0.1
"""Longest wait for an image before states are looked at again."""
ATTITUDES = 200
"""Attitude samples kept: two seconds and more at 100 Hz."""


class Sink(Protocol):
    """Takes what the eyes see; called on the event loop, returns at once."""

    def publish(self, suffix: str, value: Telemetry) -> None:
        """Put `value` on `mk/<vehicle>/<suffix>`."""


class VisionWorker:
    """Runs the cameras of one vehicle.

    Args:
        cameras: at least one, each with its own name.
        vision: detector and tracker.
        sink: where values go.
        loop: the event loop `sink` lives on.
        clock: stamps.
        session: gives the Zenoh session for `zenoh:` sources.
        open_source: chooses the source a camera section names.

    Raises:
        ConfigError: a source, camera file or target file is wrong, or two cameras share a name.
    """

    def __init__(
        self,
        cameras: Sequence[CameraSection],
        vision: VisionSection,
        sink: Sink,
        loop: asyncio.AbstractEventLoop,
        clock: Clock,
        session: Callable[[], zenoh.Session] | None = None,
        *,
        open_source: Callable[[CameraSection, Callable[[], zenoh.Session] | None], Source] = source_of,
    ) -> None:
        names = [cfg.name for cfg in cameras]
        for name in names:
            if names.count(name) > 1:
                msg = f"two cameras are called '{name}'; give one of them another name"
                raise ConfigError(msg)
        self._sink = sink
        self._loop = loop
        self._clock = clock
        self._slots: NewestSlots[CameraImage] = NewestSlots()
        self._eyes: dict[str, _Eye] = {}
        for cfg in cameras:
            slot = self._slots.add()
            self._eyes[cfg.name] = _Eye(
                CameraPipeline(cfg, vision, clock), CameraStream(cfg, open_source(cfg, session), slot), slot
            )
        self._attitudes: deque[AttitudeSample] = deque(maxlen=ATTITUDES)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="vision", daemon=True)

    def start(self) -> None:
        """Start all threads."""
        for eye in self._eyes.values():
            eye.stream.start()
        self._thread.start()

    def stop(self, timeout: float = 3.0) -> None:
        """End all threads within `timeout` [s] together; idempotent, and harmless before `start`."""
        self._stop.set()
        for eye in self._eyes.values():
            eye.stream.request_stop()
        end = time.monotonic() + timeout
        for eye in self._eyes.values():
            eye.stream.stop(max(end - time.monotonic(), 0.0))
        if self._thread.ident is not None:
            self._thread.join(max(end - time.monotonic(), 0.0))

    def attitude_arrived(self, sample: AttitudeSample) -> None:
        """Take the vehicle's attitude; from any thread."""
        self._attitudes.append(sample)

    def _run(self) -> None:
        cv2.setNumThreads(1)
        while not self._stop.is_set():
            image = self._slots.take(LOOK_EVERY)
            values: list[tuple[str, Telemetry]] = []
            if image is not None:
                values += self._eyes[image.camera].look(image, AttitudeHistory(tuple(self._attitudes)))
            for eye in self._eyes.values():
                values += eye.report(self._clock.stamp())
            if values and not self._hand_over(values):
                return

    def _hand_over(self, values: list[tuple[str, Telemetry]]) -> bool:
        """Give values to the loop; false when it is closed, which ends the worker."""
        try:
            self._loop.call_soon_threadsafe(self._publish, values)
        except RuntimeError:
            return False
        return True

    def _publish(self, values: list[tuple[str, Telemetry]]) -> None:
        for suffix, value in values:
            self._sink.publish(suffix, value)


class _Eye:
    """One camera: its pipeline, its stream and when it last reported."""

    def __init__(self, pipeline: CameraPipeline, stream: CameraStream, slot: NewestSlot[CameraImage]) -> None:
        self.pipeline = pipeline
        self.stream = stream
        self._slot = slot
        self._reported: tuple[EyeState, tuple[Alarm, ...]] | None = None
        self._due = 0.0

    def look(self, image: CameraImage, attitude: AttitudeHistory) -> list[tuple[str, Telemetry]]:
        values = self.pipeline.process(image, attitude)
        picture = self.pipeline.picture(image)
        return [*values, picture] if picture is not None else values

    def report(self, stamp: Stamp) -> list[tuple[str, Telemetry]]:
        """Stats and the static frame, once a second and when the state changes."""
        status = self.stream.status()
        facts = (self.pipeline.state(status)[0], self.pipeline.alarms)
        if facts == self._reported and stamp.monotonic < self._due:
            return []
        stats = self.pipeline.stats(status, self._slot.dropped, stamp)
        self._reported, self._due = facts, stamp.monotonic + STATS_EVERY
        name = self.pipeline.cfg.name
        values: list[tuple[str, Telemetry]] = [(f"vision/{name}/stats", stats)]
        mount = self.pipeline.mount(stamp)
        return [*values, ("tf", mount)] if mount is not None else values
