"""One camera in its own thread: opened, read, stamped, judged, handed over; opened again when it vanishes.

When was an image taken: from the driver's stamp where there is one, with its clock's offset measured.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import VisionError
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.vision.camera.exposure import Adjustable, Reach, Setting
from mkdaemon.vision.camera.image import CameraImage, EndOfImages, PictureError, Shot, Source
from mkdaemon.vision.camera.slot import NewestSlot

WINDOW_TIME = 10.0
"""Looked back at, short against the drift of a clock [s]."""
PROOF = 2.0
"""How long stamps on another clock are watched before they are believed [s]."""
DRIFT = 0.002
"""Clocks differ by less than this; the nominal rate some streams count in differs by far more."""
JITTER = 0.015
"""What the smallest delay of a second may differ from the next one's on a busy network [s]."""
LOST = 0.3
"""Growth of the smallest delay that no network explains: believed stamps are given up [s]."""
RECENT = 0.5
"""Over so long that growth is looked for [s]."""
MAX_AGE = 2.0
"""A driver stamp older than this against our own clock is not on our clock."""


class StampClock:
    """Turns driver stamps into our monotonic clock.

    A driver stamp on our clock (V4L2 stamps buffers with CLOCK_MONOTONIC) is taken as it is. On another clock the
    smallest delay seen between stamp and arrival is its offset: jitter of the transport is removed, its constant part
    cannot be seen and is the configured latency.

    Not every stamp is a time: FFmpeg numbers the images of an HTTP stream at 25 a second whatever the camera does, so
    a camera of 10 a second seemed 4.7 s late after 8 s. Stamps on another clock are therefore believed only while they
    run as fast as ours; until then, and otherwise, an image was taken when it arrived.
    """

    def __init__(self, latency: float = 0.0) -> None:
        self._latency = latency
        self._seen: deque[tuple[float, float]] = deque()
        """Arrival and delay of each image [s]."""
        self._last = -math.inf
        self._believed = False

    def stamp(self, driver: float | None, arrived: float) -> tuple[float, str]:
        """Return when an image was taken [s; monotonic] and who knew: `driver` or `arrival`.

        From the driver's stamp [s; any clock], where it has one, and the arrival [s; monotonic].
        """
        if driver is None or not math.isfinite(driver) or driver <= 0.0:
            return arrived - self._latency, "arrival"
        if driver < self._last - 1.0:
            self._seen.clear()  # the stream started again
            self._believed = False
        self._last = driver
        if 0.0 <= arrived - driver <= MAX_AGE:
            return driver - self._latency, "driver"
        self._seen.append((arrived, arrived - driver))
        while self._seen[0][0] < arrived - WINDOW_TIME:
            self._seen.popleft()
        self._believed = self._runs_as_ours()
        if not self._believed:
            return arrived - self._latency, "arrival"
        return driver + min(delay for _, delay in self._seen) - self._latency, "driver"

    def _runs_as_ours(self) -> bool:
        """Believed when the smallest delay stays over the window, until it has grown too far."""
        first, last = self._seen[0][0], self._seen[-1][0]
        if self._believed:
            recent = min(delay for at, delay in self._seen if at >= last - RECENT)
            if recent - min(delay for _, delay in self._seen) <= LOST:
                return True
            self._seen.clear()  # the proof begins anew
            return False
        if last - first < PROOF:
            return False
        middle = 0.5 * (first + last)
        older = min(delay for at, delay in self._seen if at <= middle)
        younger = min(delay for at, delay in self._seen if at > middle)
        return abs(younger - older) <= JITTER + DRIFT * (last - first)


READ_TIMEOUT = 0.25
DAMAGE_SHOWN = 1.0
"""How long a damaged image is told [s]."""
RATE_IMAGES = 31
"""Images the rate is counted over; the mean of inverse gaps would be too high wherever images come in bursts."""


@dataclass(frozen=True, slots=True)
class StreamStatus:
    """What is known about a camera now.

    Attributes:
        state: `OK` while images come, or why not.
        reason: one sentence for everything else.
        images: taken since the start.
        lost: gaps in the source's own count.
        dropped: that a newer one replaced before anybody looked.
        damaged: images that were refused because they were none or damaged.
        damage: what was wrong with the newest of them, for a second after it; empty otherwise.
        reopened: how often it was opened again.
        fps: rate of the last second or so [Hz].
        width: of the last image [px].
        height: of the last image [px].
        stamped_by: who knew the capture time.
        refused: settings the driver did not take.
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
    stamped_by: str = ""
    refused: tuple[str, ...] = ()


def retry_delays(first: float, longest: float) -> Iterator[float]:
    """Delays before the next attempt [s]: doubling from `first` to `longest`."""
    delay = first
    while True:
        yield delay
        delay = min(2 * delay, longest)


class CameraStream:
    """Runs a source of images in a thread; the newest one waits in `slot`."""

    def __init__(self, cfg: CameraSection, source: Source, slot: NewestSlot[CameraImage]) -> None:
        self.cfg = cfg
        self._source = source
        self._slot = slot
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"camera-{cfg.name}", daemon=True)
        self._status = StreamStatus()
        self._clock = StampClock(cfg.latency_ms / 1000.0)
        self._arrivals: deque[float] = deque(maxlen=RATE_IMAGES)
        self._last_arrival = 0.0
        self._damaged_at = -math.inf
        self._wanted: Setting | None = None
        self._refused: tuple[str, ...] = ()
        self._last_sequence: int | None = None

    @property
    def reach(self) -> Reach | None:
        """What the camera can be told about its exposure; none where it takes nothing."""
        return self._source.reach if isinstance(self._source, Adjustable) else None

    def adjust(self, setting: Setting) -> None:
        """Have the thread tell the camera before it waits for the next image."""
        self._wanted = setting

    def start(self) -> None:
        """Start the thread; opening happens there."""
        self._thread.start()

    def request_stop(self) -> None:
        """Tell the thread to end, without waiting for it."""
        self._stop.set()
        self._slot.close()

    def stop(self, timeout: float = 3.0) -> None:
        """End the thread; a driver that hangs is left behind, its thread does not keep the process alive."""
        self.request_stop()
        if self._thread.ident is not None:
            self._thread.join(timeout)

    def status(self) -> StreamStatus:
        """The camera's state now; an image that is overdue makes it silent."""
        status, now = replace(self._status, dropped=self._slot.dropped), time.monotonic()
        if now - self._damaged_at > DAMAGE_SHOWN:
            status = replace(status, damage="")
        overdue = now - self._last_arrival
        if status.state is EyeState.OK and self._source.live and overdue > self.cfg.silent_after:
            reason = status.damage or f"no image for {overdue:.1f} s"
            return replace(status, state=EyeState.SILENT, reason=reason, fps=0.0)
        return status

    def _run(self) -> None:
        delays = retry_delays(self.cfg.reopen_min, self.cfg.reopen_max)
        while not self._stop.is_set():
            try:
                before = self._status.images
                try:
                    self._refused = self._source.open()
                    self._last_arrival = time.monotonic()
                    self._status = replace(self._status, state=EyeState.OK, reason="", refused=self._refused)
                    self._arrivals.clear()
                    self._read_on()
                finally:
                    self._source.close()
                    if self._status.images > before:
                        delays = retry_delays(self.cfg.reopen_min, self.cfg.reopen_max)
            except EndOfImages:
                self._slot.wait_taken()
                self._status = replace(self._status, state=EyeState.ENDED, reason="all images were shown", fps=0.0)
                return
            except Exception as error:  # noqa: BLE001  # no driver and no image may end this thread
                reason = str(error) if isinstance(error, VisionError) else f"{type(error).__name__}: {error}"
                reopened = self._status.reopened + 1
                self._status = replace(self._status, state=EyeState.GONE, reason=reason, fps=0.0, reopened=reopened)
            self._stop.wait(next(delays))

    def _read_on(self) -> None:
        """Read until told to stop or the source is gone."""
        while not self._stop.is_set():
            wanted, self._wanted = self._wanted, None
            if wanted is not None and isinstance(self._source, Adjustable):
                self._status = replace(self._status, refused=(*self._refused, *self._source.adjust(wanted)))
            try:
                shot = self._source.read(READ_TIMEOUT)
            except PictureError as error:
                self._damaged_at = time.monotonic()
                self._status = replace(self._status, damaged=self._status.damaged + 1, damage=str(error))
                continue
            if shot is None:
                continue
            if not self._source.live:
                self._slot.wait_taken()
            self._hand_over(shot)

    def _hand_over(self, shot: Shot) -> None:
        captured_at, stamped_by = self._clock.stamp(shot.stamp, shot.arrived)
        if stamped_by == "driver":
            stamped_by = shot.stamped_by
        step = 1
        if shot.sequence is not None and self._last_sequence is not None and shot.sequence > self._last_sequence:
            step = shot.sequence - self._last_sequence
        self._last_sequence = shot.sequence
        self._arrivals.append(shot.arrived)
        spent = shot.arrived - self._arrivals[0]
        self._last_arrival = shot.arrived
        height, width = shot.pixels.shape
        self._status = replace(
            self._status,
            images=self._status.images + 1,
            lost=self._status.lost + step - 1,
            fps=(len(self._arrivals) - 1) / spent if spent > 0.0 else 0.0,
            width=width,
            height=height,
            stamped_by=stamped_by,
        )
        sequence = self._status.images + self._status.lost
        self._slot.put(CameraImage(shot.pixels, captured_at, shot.arrived, sequence, self.cfg.name, stamped_by))
