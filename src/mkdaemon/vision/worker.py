"""All cameras through one worker thread, watched from the event loop, which it never holds up."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final, NamedTuple

import cv2
import structlog

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.errors import ConfigError
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.vision import AttitudeLoss, EyeState
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.image import CameraImage, ImageSource, NewestSlot
from mkdaemon.vision.camera.sources import source_of
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample

LOOK_EVERY: Final = 0.1
"""Longest wait for an image before states are looked at again, and between two looks at the thread [s]."""
STALLED_AFTER: Final = 0.5
"""Time without a sign of life from the thread after which its cameras count as stalled [s]; an image takes 10 ms."""
ATTITUDES = 200
"""Attitude samples kept: two seconds and more at 100 Hz."""
BAROMETER = 50
"""Heights of the barometer kept until the thread takes them."""

_log = structlog.get_logger(__name__)


class _Eye(NamedTuple):
    """One camera."""

    pipeline: CameraPipeline
    stream: CameraStream


def camera_mistakes(cameras: Sequence[CameraSection], vision: VisionSection, clock: Clock) -> Iterator[ConfigError]:
    """Mistakes of cameras, their files and their targets; no camera is opened."""
    checks: list[Callable[[], object]] = [partial(_require_names, cameras)]
    for cfg in cameras:
        checks += [partial(source_of, cfg), partial(CameraPipeline, cfg, vision, clock)]
    for check in checks:
        try:
            check()
        except ConfigError as error:
            yield error


def _require_names(cameras: Sequence[CameraSection]) -> None:
    for name, count in Counter(cfg.name for cfg in cameras).items():
        if count > 1:
            msg = f"two cameras are called '{name}'; give one of them another name"
            raise ConfigError(msg)


class VisionWorker:
    """Runs the cameras of one vehicle.

    Args:
        publish: puts a value on `mk/<vehicle>/<suffix>`; called on the event loop, returns at once.
        record: takes every image before it is looked at, with the attitude it is looked at with; called on the
            worker's thread, returns at once.

    Raises:
        ConfigError: a source, camera file or target file is wrong, or two cameras share a name.
    """

    def __init__(
        self,
        cameras: Sequence[CameraSection],
        vision: VisionSection,
        publish: Callable[[str, Telemetry], None],
        loop: asyncio.AbstractEventLoop,
        clock: Clock,
        *,
        open_source: Callable[[CameraSection], ImageSource] = source_of,
        record: Callable[[CameraImage, AttitudeHistory], None] = lambda image, attitude: None,
    ) -> None:
        _require_names(cameras)
        self._put, self._record, self._loop, self._clock = publish, record, loop, clock
        self._slot: NewestSlot[CameraImage] = NewestSlot()
        self._eyes = {
            cfg.name: _Eye(CameraPipeline(cfg, vision, clock), CameraStream(cfg, open_source(cfg), self._slot))
            for cfg in cameras
        }
        self._attitudes: deque[AttitudeSample] = deque(maxlen=ATTITUDES)
        self._barometer: deque[tuple[float, float]] = deque(maxlen=BAROMETER)
        self._stop = threading.Event()
        self._alive_at = clock.now()
        self._failure: BaseException | None = None
        self._thread = self._new_thread()

    def start(self) -> None:
        """Start all threads; report at once that cameras are being opened, so that no flight starts without them."""
        for eye in self._eyes.values():
            self._publish(eye.pipeline.report(eye.stream.status(), self._clock.stamp()))
            eye.stream.start()
        self._alive_at = self._clock.now()
        self._thread.start()

    async def supervise(self) -> None:
        """Tell when the thread stands still or has died, and start it again; never returns."""
        while True:
            await asyncio.sleep(LOOK_EVERY)
            silence = self._clock.now() - self._alive_at
            if self._thread.ident is not None and not self._thread.is_alive() and not self._stop.is_set():
                self._restart(self._failure or RuntimeError("it ended without a word"))
            elif silence > STALLED_AFTER:
                self._report_all(EyeState.STALLED, f"the detector has not come back from an image for {silence:.1f} s")

    def stop(self, timeout: float = 3.0) -> None:
        """End all threads within `timeout` [s] together; idempotent, and harmless before `start`."""
        self._stop.set()
        end = time.monotonic() + timeout
        for eye in self._eyes.values():
            eye.stream.stop(0.0)  # all are stopped before one is waited for
        for eye in self._eyes.values():
            eye.stream.stop(max(end - time.monotonic(), 0.0))
        if self._thread.ident is not None:
            self._thread.join(max(end - time.monotonic(), 0.0))

    def attitude_arrived(self, sample: AttitudeSample) -> None:
        """Take the vehicle's attitude; from one thread. NaN is counted, and left out of the history."""
        if not sample.is_number:
            for eye in self._eyes.values():
                eye.pipeline.attitude_lost[AttitudeLoss.NOT_A_NUMBER] += 1
        self._attitudes.append(sample)

    def barometer_arrived(self, time: float, height: float) -> None:
        """Take the barometer's height [m] at a time [s; monotonic]; from any thread."""
        self._barometer.append((time, height))

    def _new_thread(self) -> threading.Thread:
        return threading.Thread(target=self._run, name="vision", daemon=True)

    def _restart(self, failure: BaseException) -> None:
        """Start a new thread in place of one that has ended by an exception."""
        reason = f"the detector's thread ended by {type(failure).__name__}: {failure}; started again"
        _log.error(reason, exc_info=failure)
        self._report_all(EyeState.DEAD, reason)
        self._failure = None
        for eye in self._eyes.values():
            eye.pipeline.restarted(failure)
        self._alive_at = self._clock.now()
        self._thread = self._new_thread()
        self._thread.start()

    def _report_all(self, state: EyeState, reason: str) -> None:
        """Publish, from the loop, what the thread cannot report about itself."""
        change = {"state": state, "reason": reason, "stamp": self._clock.stamp()}
        for name, eye in self._eyes.items():
            if eye.pipeline.reported is not None:
                self._put(f"vision/{name}/stats", eye.pipeline.reported.model_copy(update=change))

    def _run(self) -> None:
        try:
            cv2.setNumThreads(1)
            while not self._stop.is_set():
                self._alive_at = self._clock.now()
                self._look(self._slot.take(LOOK_EVERY))
        except BaseException as error:  # noqa: BLE001  # the loop tells it and starts another thread
            self._failure = error

    def _look(self, image: CameraImage | None) -> None:
        """Look at an image, if there is one; what can wait is done once its poses are handed over."""
        while self._barometer:
            reading = self._barometer.popleft()
            for eye in self._eyes.values():
                eye.pipeline.selfcheck.barometer_received(*reading)
        values: list[tuple[str, Telemetry]] = []
        if image is not None:
            attitude, eye = AttitudeHistory(tuple(self._attitudes)), self._eyes[image.camera]
            self._record(image, attitude)
            self._hand_over(eye.pipeline.process(image, attitude))
            values += eye.pipeline.look_again(image, eye.stream.status().control)
        for eye in self._eyes.values():
            values += eye.pipeline.report(eye.stream.status(), self._clock.stamp())
        self._hand_over(values)

    def _hand_over(self, values: list[tuple[str, Telemetry]]) -> None:
        """Give values to the loop; where it is closed this raises, which ends the worker."""
        if values:
            self._loop.call_soon_threadsafe(self._publish, values)

    def _publish(self, values: list[tuple[str, Telemetry]]) -> None:
        for suffix, value in values:
            self._put(suffix, value)
