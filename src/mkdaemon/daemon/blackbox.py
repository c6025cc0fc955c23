"""The daemon's own recorder: taps where things pass, and a thread that writes.

It stands beside the flight: nothing here waits, and whatever becomes of the disk, the worst is an entry that is lost
and counted.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.recording import BusRecorder, NoRecorder
from mkdaemon.clock import Clock
from mkdaemon.config.record import RecordConfig, RecordedImages
from mkdaemon.config.root import Config
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.eyes import RecordImage
from mkdaemon.daemon.localsocket import Answer
from mkdaemon.daemon.procedures import state_folder
from mkdaemon.record.entry import Notice
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.tap import Tap
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.record import BusCounts, RecorderState, RecordStatus

if TYPE_CHECKING:
    from mkdaemon.record.folder import RecordingFolder, RoomLimits
    from mkdaemon.record.recorder import RecorderThread
    from mkdaemon.vision.camera.image import CameraImage
    from mkdaemon.vision.track.attitude import AttitudeHistory

PERIOD: Final = 1.0
"""Of what is published about the recorder [s]."""
MEGA: Final = 1_000_000
LOCAL: Final = "local"
"""Source of requests over the Unix socket."""
LOCAL_EXCHANGES: Final = 1 << 30
"""Number of the first request over the Unix socket; the bus counts its own from 1."""


class BlackBox:
    """A recorder that runs with the daemon.

    Attributes:
        tap: takes what passes; None where nothing is recorded.
    """

    def __init__(
        self,
        clock: Clock,
        thread: RecorderThread | None = None,
        tap: Tap | None = None,
        folder: RecordingFolder | None = None,
    ) -> None:
        """Take what was prepared; see `open_black_box`. Without a thread and a tap nothing is recorded."""
        self._folder = folder
        self._images: ImageRecorder | None = None
        self.tap = tap
        self._thread = thread
        self._clock = clock
        self._state = RecorderState.OFF
        self._local_exchanges = count(LOCAL_EXCHANGES)

    @property
    def bus_recorder(self) -> BusRecorder:
        """Recorder of the bus."""
        return NoRecorder() if self.tap is None else self.tap

    @asynccontextmanager
    async def run(self) -> AsyncIterator[None]:
        """Write while the context lasts; what waits at its end is written too, if the disk takes it at once."""
        if self._thread is None:
            yield
            return
        self._thread.start()
        try:
            yield
        finally:
            await asyncio.to_thread(self._thread.stop)

    def note_stop(self) -> None:
        """Record that an orderly stop of the daemon was requested."""
        if self.tap is not None:
            self.tap.notice(Notice.STOP)

    def image_recorder(self, cfg: RecordedImages) -> RecordImage:
        """Recorder of the cameras' images."""
        if self.tap is None:
            return lambda image, attitude: None
        self._images = ImageRecorder(cfg, self.tap, self._clock)
        return self._images.record

    def reconfigure(self, cfg: RecordConfig) -> None:
        """Take up how much room there is, and which images are recorded."""
        if self._folder is not None:
            self._folder.limits = limits_of(cfg)
        if self._images is not None:
            self._images.reconfigure(cfg.images)

    def recorded(self, answer: Answer) -> Answer:
        """Return a function that answers requests of the Unix socket and records them."""
        tap = self.tap
        if tap is None:
            return answer

        async def answer_recorded(suffix: str, payload: bytes) -> CommandResult:
            exchange = next(self._local_exchanges)
            tap.query(suffix, payload, exchange, LOCAL)
            result = await answer(suffix, payload)
            tap.reply(suffix, encode(result), encoding_of(CommandResult), exchange)
            return result

        return answer_recorded

    async def report(self, bus: Bus, audit: Audit) -> None:
        """Publish what the recorder does, once a second, for ever; a change is a line in the log."""
        while True:
            status = self.status()
            must_log = status.state is not RecorderState.RECORDING or status.file
            if status.state is not self._state and must_log:
                self._state = status.state
                text = f"records to {status.file}" if status.state is RecorderState.RECORDING else status.reason
                level = "info" if status.state is RecorderState.RECORDING else "warning"
                audit.log(level, f"black box {status.state}: {text}")
            bus.publish("record/status", status)
            bus.publish("bus/counts", BusCounts(stamp=self._clock.stamp(), counts=bus.counts()))
            await asyncio.sleep(PERIOD)

    def status(self) -> RecordStatus:
        """State of the recorder."""
        stamp = self._clock.stamp()
        if self._thread is None:
            return RecordStatus(
                stamp=stamp,
                state=RecorderState.OFF,
                reason="record.enabled is off, or a recording plays",
                file="",
                file_bytes=0,
                total_bytes=0,
                free_bytes=None,
                entries=0,
                lost=0,
                queue_bytes=0,
                queue_limit_bytes=0,
            )
        report, queue = self._thread.report, self._thread.recorder.queue
        return RecordStatus(
            stamp=stamp,
            state=report.state,
            reason=report.reason,
            file="" if report.file is None else str(report.file),
            file_bytes=report.file_bytes,
            total_bytes=report.total_bytes,
            free_bytes=report.free_bytes,
            entries=report.entries,
            lost=queue.lost,
            queue_bytes=queue.size,
            queue_limit_bytes=queue.capacity,
        )


def open_black_box(cfg: Config, clock: Clock, *, is_recording: bool) -> BlackBox:
    """Prepare the recorder; nothing is written before `run`.

    Args:
        cfg: all of it.
        clock: of the daemon.
        is_recording: whether a recording plays, which is not recorded again.
    """
    wanted, folder = cfg.record, recording_folder(cfg)
    if folder is None or is_recording:
        return BlackBox(clock)
    from mkdaemon.bus.schema import schema_json
    from mkdaemon.record.entry import TimeBase
    from mkdaemon.record.folder import RecordingFolder, recording_name
    from mkdaemon.record.layout import Session
    from mkdaemon.record.recorder import Recorder, RecorderThread
    from mkdaemon.record.view import JsonView

    stamp, vehicle = clock.stamp(), cfg.vehicle.name
    base = TimeBase.of(stamp)
    queue = EntryQueue(wanted.queue_mb * MEGA)
    room = RecordingFolder(folder, vehicle, limits_of(wanted))
    name = recording_name(vehicle, stamp.wall)
    session = Session.begin("blackbox", name, base, vehicle=vehicle, config=cfg.model_dump_json())
    recorder = Recorder(
        queue,
        room,
        session,
        view=JsonView(schema_json) if wanted.json_for_viewers else None,
        sync_period=wanted.sync_s,
    )
    return BlackBox(clock, RecorderThread(recorder), Tap(queue, clock, vehicle, base), room)


def limits_of(cfg: RecordConfig) -> RoomLimits:
    """Limits of the room for recordings."""
    from mkdaemon.record.folder import RoomLimits

    return RoomLimits(
        file_bytes=cfg.file_mb * MEGA,
        file_time=cfg.file_minutes * 60,
        total_bytes=cfg.total_mb * MEGA,
        free_bytes=cfg.free_mb * MEGA,
        may_delete=cfg.delete_oldest,
    )


def recording_folder(cfg: Config) -> Path | None:
    """Folder of a vehicle's recordings; None without recording."""
    if not cfg.record.enabled:
        return None
    return cfg.record.folder or state_folder(cfg.vehicle) / "recordings"


JITTER: Final = 0.1
"""Share of the period by which an image may come early and still be taken."""


class ImageRecorder:
    """Takes every image on the vision thread, and records as many as the configuration says."""

    def __init__(self, cfg: RecordedImages, tap: Tap, clock: Clock) -> None:
        self._cfg = cfg
        self._tap = tap
        self._clock = clock
        self._next: dict[str, float] = {}

    def reconfigure(self, cfg: RecordedImages) -> None:
        """Record other images from the next one on."""
        self._cfg = cfg

    def record(self, image: CameraImage, attitude: AttitudeHistory) -> None:
        """Record an image if one is due, and how much was known of the attitude by then."""
        if self._cfg.hz <= 0.0:
            return
        due, period = self._next.get(image.camera, image.received_at), 1.0 / self._cfg.hz
        if image.received_at < due - JITTER * period:
            return
        self._next[image.camera] = max(due + period, image.received_at + 0.5 * period)
        self._tap.image_seen(image.camera, image.sequence, samples[-1].time if (samples := attitude.samples) else None)
        stamp = self._clock.stamp(image.captured_at)
        self._tap.image(
            f"vision/{image.camera}/image",
            lambda: self._compressed(image, stamp),
            stamp,
            image.stamped_by,
            at=image.received_at,
            size=image.pixels.nbytes,
        )

    def _compressed(self, image: CameraImage, stamp: Stamp) -> tuple[bytes, str]:
        from mkdaemon.vision.camera.imagecodec import frame_of

        quality = None if self._cfg.coding == "png" else self._cfg.jpeg_quality
        return encode(frame_of(image, stamp, quality, image.pixels.shape[1])), encoding_of(CameraFrame)
