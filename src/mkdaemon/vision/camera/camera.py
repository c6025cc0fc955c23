"""One camera in its own thread: opened, read, stamped, judged, handed over; opened again when it vanishes."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from typing import NamedTuple

from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import VisionError
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.vision.camera.exposure import ExposureControl
from mkdaemon.vision.camera.image import CameraImage, EndOfImages, ImageSource, NewestSlot, PictureError, Shot

WINDOW_TIME = 10.0
"""Looked back at, short against the drift of a clock [s]."""
PROOF = 2.0
"""How long stamps of another clock are compared before they are used [s]."""
DRIFT = 0.002
"""Clocks differ by less than this; the nominal rate some streams count in differs by far more."""
JITTER = 0.015
"""What the smallest delay of a second may differ from the next one's on a busy network [s]."""
LOST = 0.3
"""Growth of the smallest delay that no network explains: believed stamps are given up [s]."""
RECENT = 0.5
"""Time over which that growth is measured [s]."""
MAX_AGE = 2.0
"""A driver stamp older than this against our own clock is not on our clock."""
READ_TIMEOUT = 0.25
DAMAGE_SHOWN = 1.0
"""Duration of the alarm after a damaged image [s]."""
RATE_IMAGES = 31
"""Images the rate is counted over; the mean of inverse gaps would be too high wherever images come in bursts."""


class StampClock:
    """Turns driver stamps into our monotonic clock.

    A driver stamp on our clock (V4L2 stamps buffers with CLOCK_MONOTONIC) is taken as it is. Of another clock the
    smallest delay between stamp and arrival is the offset; its constant part is the configured latency [s].

    Not every stamp is a time: FFmpeg numbers the images of an HTTP stream at 25 a second whatever the camera does.
    Stamps of another clock are used while they run as fast as ours; else the arrival is the stamp.
    """

    def __init__(self, latency: float = 0.0) -> None:
        self._latency = latency
        self._seen: deque[tuple[float, float]] = deque()
        """Arrival and delay of each image [s]."""
        self._last = -math.inf
        self._believed = False

    def stamp(self, driver: float | None, arrived: float) -> tuple[float, str]:
        """Capture time of an image [s; monotonic], and its source: the `driver` [s; any clock], or its `arrival`."""
        taken = self._on_our_clock(driver, arrived) if driver is not None and 0.0 < driver < math.inf else None
        return (arrived if taken is None else taken) - self._latency, "arrival" if taken is None else "driver"

    def _on_our_clock(self, driver: float, arrived: float) -> float | None:
        if driver < self._last - 1.0:
            self._seen.clear()  # the stream started again
            self._believed = False
        self._last = driver
        if 0.0 <= arrived - driver <= MAX_AGE:
            return driver
        self._seen.append((arrived, arrived - driver))
        while self._seen[0][0] < arrived - WINDOW_TIME:
            self._seen.popleft()
        # The smallest delay of a window is the offset of the clocks, as queues only add to it. Source: D. Mills,
        # RFC 5905, section 10 (the clock filter of NTP). A constant part of the delay cannot be seen.
        least = self._least_delay()
        if self._believed:
            self._believed = self._least_delay(arrived - RECENT) - least <= LOST
            if not self._believed:
                self._seen.clear()  # the proof restarts
        else:
            first = self._seen[0][0]
            middle = 0.5 * (first + arrived)
            # Clocks that run alike have the same least delay in both halves, but for jitter and drift.
            growth = self._least_delay(middle) - self._least_delay(until=middle)
            self._believed = arrived - first >= PROOF and abs(growth) <= JITTER + DRIFT * (arrived - first)
        return driver + least if self._believed else None

    def _least_delay(self, since: float = -math.inf, until: float = math.inf) -> float:
        return min(delay for at, delay in self._seen if since <= at <= until)


class StreamStatus(NamedTuple):
    """State of a camera; fields not described here are in `VisionStats` by the same name.

    Attributes:
        images: that came.
        damage: what was wrong with the newest damaged image, for a second after it; empty otherwise.
        control: sets exposure and gain before an image; None if the camera accepts neither.
    """

    state: EyeState = EyeState.OPENING
    reason: str = "not opened yet"
    images: int = 0
    lost: int = 0
    dropped: int = 0
    damaged: int = 0
    damage: str = ""
    reopened: int = 0
    fps: float = 0.0
    width: int = 0
    height: int = 0
    settings_refused: tuple[str, ...] = ()
    control: ExposureControl | None = None


class CameraStream:
    """Runs a source of images in a thread; the newest one waits in `slot`."""

    def __init__(self, cfg: CameraSection, source: ImageSource, slot: NewestSlot[CameraImage]) -> None:
        self.cfg, self._source, self._slot = cfg, source, slot
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"camera-{cfg.name}", daemon=True)
        self._status = StreamStatus()
        self._clock = StampClock(cfg.latency_ms / 1000.0)
        self._arrivals: deque[float] = deque(maxlen=RATE_IMAGES)
        self._last_arrival = 0.0
        self._damaged_at = -math.inf
        self._last_sequence: int | None = None

    def start(self) -> None:
        """Start the thread; opening happens there."""
        self._thread.start()

    def stop(self, timeout: float = 3.0) -> None:
        """End the thread; a driver that hangs is left behind, its thread does not keep the process alive."""
        self._stop.set()
        self._slot.close()
        if self._thread.ident is not None:
            self._thread.join(timeout)

    def status(self) -> StreamStatus:
        """The camera's state now; an image that is overdue makes it silent."""
        status, now = self._status._replace(dropped=self._slot.dropped[self.cfg.name]), time.monotonic()
        if now - self._damaged_at > DAMAGE_SHOWN:
            status = status._replace(damage="")
        overdue = now - self._last_arrival
        if status.state is EyeState.OK and self._source.live and overdue > self.cfg.silent_after:
            reason = status.damage or f"no image for {overdue:.1f} s"
            return status._replace(state=EyeState.SILENT, reason=reason, fps=0.0)
        return status

    def _run(self) -> None:
        delay = self.cfg.reopen_min
        while not self._stop.is_set():
            before = self._status.images
            try:
                try:
                    self._read_on(self._source.open())
                finally:
                    self._source.close()
            except EndOfImages:
                self._slot.wait_taken(self.cfg.name)
                self._status = self._status._replace(state=EyeState.ENDED, reason="all images were shown", fps=0.0)
                return
            except Exception as error:  # noqa: BLE001  # no driver and no image may end this thread
                reason = str(error) if isinstance(error, VisionError) else f"{type(error).__name__}: {error}"
                reopened = self._status.reopened + 1
                self._status = self._status._replace(state=EyeState.GONE, reason=reason, fps=0.0, reopened=reopened)
            if self._status.images > before:
                delay = self.cfg.reopen_min
            self._stop.wait(delay)
            delay = min(2 * delay, self.cfg.reopen_max)

    def _read_on(self, refused: tuple[str, ...]) -> None:
        """Read until `stop` or the end of the source; `refused` are settings it did not take when it was opened."""
        controls, applied = self._source.controls, None
        reach = controls.reach if controls is not None else None
        control = ExposureControl(reach) if reach is not None else None
        self._last_arrival = time.monotonic()
        self._status = self._status._replace(state=EyeState.OK, reason="", settings_refused=refused, control=control)
        self._arrivals.clear()
        while not self._stop.is_set():
            if controls is not None and control is not None and control.setting is not applied:
                applied = control.setting
                self._status = self._status._replace(settings_refused=(*refused, *controls.adjust(applied)))
            try:
                shot = self._source.read(READ_TIMEOUT)
            except PictureError as error:
                self._damaged_at = time.monotonic()
                self._status = self._status._replace(damaged=self._status.damaged + 1, damage=str(error))
                continue
            if shot is not None:
                self._hand_over(shot)

    def _hand_over(self, shot: Shot) -> None:
        if not self._source.live:
            self._slot.wait_taken(self.cfg.name)
        captured_at, stamped_by = self._clock.stamp(shot.stamp, shot.arrived)
        if stamped_by == "driver":
            stamped_by = shot.stamped_by
        lost, last = self._status.lost, self._last_sequence
        if shot.sequence is not None and last is not None:
            lost += max(shot.sequence - last - 1, 0)
        self._last_sequence = shot.sequence
        self._arrivals.append(shot.arrived)
        spent = shot.arrived - self._arrivals[0]
        self._last_arrival = shot.arrived
        height, width = shot.pixels.shape
        images, fps = self._status.images + 1, (len(self._arrivals) - 1) / spent if spent > 0.0 else 0.0
        self._status = self._status._replace(images=images, lost=lost, fps=fps, width=width, height=height)
        image = CameraImage(shot.pixels, captured_at, shot.arrived, images + lost, self.cfg.name, stamped_by)
        self._slot.put(image, self.cfg.name)
