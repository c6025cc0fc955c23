"""Images of the cameras on their way to the recorder, some of them, compressed on its thread."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.clock import Clock
from mkdaemon.config.record import RecordedImages
from mkdaemon.record.tap import Tap
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.image import CameraFrame

if TYPE_CHECKING:
    from mkdaemon.vision.camera.image import CameraImage
    from mkdaemon.vision.track.attitude import AttitudeHistory

JITTER: Final = 0.1
"""Share of the period by which an image may come early and still be taken."""


class ImageRecorder:
    """Takes every image, and records as many as the configuration says; on the thread of the eyes."""

    def __init__(self, cfg: RecordedImages, tap: Tap, clock: Clock) -> None:
        self._cfg = cfg
        self._tap = tap
        self._clock = clock
        self._next: dict[str, float] = {}

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
        from mkdaemon.vision.camera.imagecodec import encode_jpeg, encode_png

        height, width = image.pixels.shape
        is_png = self._cfg.coding == "png"
        pixels = encode_png(image.pixels) if is_png else encode_jpeg(image.pixels, self._cfg.jpeg_quality, width)[0]
        frame = CameraFrame(
            stamp=stamp,
            camera=image.camera,
            sequence=image.sequence,
            width=width,
            height=height,
            coding=self._cfg.coding,
            pixels=pixels,
        )
        return encode(frame), encoding_of(CameraFrame)
