"""Where images come from: a driver, a network stream, a clip, a folder, a Zenoh key. One interface for all."""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import zenoh

from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.vision.camera.bus_images import ZenohSource
from mkdaemon.vision.camera.captured import captured_pixels, take_jpegs
from mkdaemon.vision.camera.exposure import Reach, Setting
from mkdaemon.vision.camera.files import CLIPS, ClipSource, FolderSource
from mkdaemon.vision.camera.shot import Shot, Source
from mkdaemon.vision.camera.sizewatch import StreamWatch, may_change_size, open_quietly, opened_size
from mkdaemon.vision.camera.v4l2controls import V4l2Controls

V4L2_MANUAL, V4L2_AUTO = 1, 3
"""Values of V4L2_CID_EXPOSURE_AUTO (linux/v4l2-controls.h): manual and aperture priority."""


TAKEN = 0.01
"""A setting was taken when the driver reads it back within this share."""
SHORT_LIFE, JEALOUS_FROM = 5.0, 2
"""A stream that ends within so long [s], so often in a row, may be of a camera that drops a client for the next one."""
_WHAT_TO_CHECK = {
    cv2.CAP_V4L2: "is it a camera, and does another program hold it?",
    cv2.CAP_FFMPEG: "check address, user and password, and that the camera is on",
    cv2.CAP_GSTREAMER: "try the pipeline with gst-launch-1.0; it must end in appsink",
}


def source_of(cfg: CameraSection, session: Callable[[], zenoh.Session] | None = None) -> Source:
    """Choose the source a configuration names.

    Args:
        cfg: the camera.
        session: gives the Zenoh session for `zenoh:` sources.

    Raises:
        ConfigError: nothing is known about such a source.
    """
    text = cfg.source
    scheme, _, rest = text.partition(":")
    if scheme == "zenoh" and rest:
        if session is None:
            msg = f"camera {cfg.name}: source '{text}' needs the bus; run it in the daemon"
            raise ConfigError(msg)
        return ZenohSource(rest, session)
    if scheme == "folder" and rest:
        return FolderSource(Path(rest), cfg)
    if scheme == "file" and rest:
        return ClipSource(Path(rest), cfg)
    if scheme == "gstreamer" and rest:
        return StreamSource(rest, cv2.CAP_GSTREAMER, cfg)
    if scheme in ("rtsp", "rtsps", "http", "https", "udp"):
        return StreamSource(text, cv2.CAP_FFMPEG, cfg)
    if scheme == "v4l2" and rest:
        return StreamSource(rest, cv2.CAP_V4L2, cfg)
    if re.fullmatch(r"/dev/[\w/.:-]+", text):
        return StreamSource(text, cv2.CAP_V4L2, cfg)
    path = Path(text)
    if path.is_dir():
        return FolderSource(path, cfg)
    if path.suffix.lower() in CLIPS:
        return ClipSource(path, cfg)
    msg = (
        f"camera {cfg.name}: source '{text}' is none of /dev/videoN, v4l2:PATH, rtsp://..., gstreamer:PIPELINE,"
        " file:CLIP, folder:DIR, zenoh:KEY"
    )
    raise ConfigError(msg)


class StreamSource:
    """V4L2, GStreamer or a network stream through OpenCV."""

    live = True

    def __init__(self, address: str, backend: int, cfg: CameraSection) -> None:
        self._address = address
        self._backend = backend
        self._cfg = cfg
        self._capture: cv2.VideoCapture | None = None
        self._coded = False
        self._controls: V4l2Controls | None = None
        self._watch: StreamWatch | None = None
        self._opened_at = -math.inf
        self._short_lives = 0

    @property
    def reach(self) -> Reach | None:
        """What the camera can be told; its longest exposure is at most the configured one."""
        reach = self._controls.reach if self._controls is not None else None
        return reach.up_to(self._cfg.exposure_longest_ms / 1000.0) if reach is not None else None

    def adjust(self, setting: Setting) -> tuple[str, ...]:
        """Set exposure and gain while images come; returns what the driver refused."""
        return self._controls.adjust(setting) if self._controls is not None else ()

    def open(self) -> tuple[str, ...]:
        """Open and set size, rate, exposure and gain."""
        name = cv2.videoio_registry.getBackendName(self._backend)
        if not cv2.videoio_registry.hasBackend(self._backend):
            msg = f"camera {self._cfg.name}: this OpenCV was built without {name}; use v4l2, rtsp or a Zenoh key"
            raise VisionError(msg)
        if self._backend == cv2.CAP_V4L2:
            self._check_device()
        patience_ms = round(1000 * self._cfg.reopen_max)
        options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, patience_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, patience_ms]
        capture = open_quietly(
            lambda: cv2.VideoCapture(self._address, self._backend, options if self._backend == cv2.CAP_FFMPEG else [])
        )
        if not capture.isOpened():
            msg = f"camera {self._cfg.name}: {name} cannot open {self._address}: {_WHAT_TO_CHECK[self._backend]}"
            raise VisionError(msg)
        self._capture, self._opened_at = capture, time.monotonic()
        refused = tuple(_set_controls(capture, self._cfg, self._backend))
        self._coded = take_jpegs(capture, self._backend)
        if self._cfg.exposure_ms == "target" and self._backend == cv2.CAP_V4L2:
            self._controls = V4l2Controls(Path(self._address))
            refused = (*refused, *self._controls.refused)
        if self._cfg.exposure_ms == "target" and self.reach is None:
            refused = (*refused, "exposure_ms=target: the driver lets nobody set the exposure")
        if self._backend == cv2.CAP_FFMPEG and may_change_size(capture):
            if not self._cfg.watch_size or self._short_lives >= JEALOUS_FROM:
                return (*refused, "watch_size: nobody sees a change of the picture's size")
            self._watch = StreamWatch(self._address, opened_size(capture), options, self._cfg.reopen_max)
        return refused

    def _check_device(self) -> None:
        """Say what OpenCV does not: the device is missing, or belongs to others."""
        if not Path(self._address).exists():
            msg = f"camera {self._cfg.name}: {self._address} is not there: plug it in, or see /dev/v4l/by-id"
            raise VisionError(msg)
        if not os.access(self._address, os.R_OK | os.W_OK):
            msg = (
                f"camera {self._cfg.name}: no permission for {self._address}: join the group video (usermod -aG video)"
            )
            raise VisionError(msg)

    def read(self, timeout: float) -> Shot | None:
        """Block in the driver; OpenCV releases the GIL there."""
        capture = self._capture
        good, image = capture.read() if capture is not None else (False, None)
        arrived = time.monotonic()
        if capture is None or not good or image is None:
            self._short_lives = self._short_lives + 1 if arrived - self._opened_at < SHORT_LIFE else 0
            msg = f"camera {self._cfg.name}: {self._address} gives no more images"
            raise VisionError(msg)
        if self._watch is not None and self._watch.change:
            msg = f"camera {self._cfg.name}: {self._watch.change}"
            raise VisionError(msg)
        pixels = captured_pixels(image, coded=self._coded)
        stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
        return Shot(pixels, arrived, stamp if stamp > 0.0 else None)

    def close(self) -> None:
        """Release the device."""
        if self._watch is not None:
            self._watch.close()
            self._watch = None
        if self._controls is not None:
            self._controls.close()
            self._controls = None
        if self._capture is not None:
            self._capture.release()
            self._capture = None


def _set_controls(capture: cv2.VideoCapture, cfg: CameraSection, backend: int) -> list[str]:
    """Ask the driver for what the configuration wants; returns what it did not do."""
    wanted: list[tuple[int, float, str]] = []
    if cfg.width is not None and cfg.height is not None:
        wanted += [(cv2.CAP_PROP_FRAME_WIDTH, cfg.width, "width"), (cv2.CAP_PROP_FRAME_HEIGHT, cfg.height, "height")]
    if cfg.fps is not None:
        wanted.append((cv2.CAP_PROP_FPS, cfg.fps, "fps"))
    if cfg.exposure_ms == "auto":
        wanted.append((cv2.CAP_PROP_AUTO_EXPOSURE, V4L2_AUTO, "exposure_ms"))
    elif isinstance(cfg.exposure_ms, float):
        # V4L2_CID_EXPOSURE_ABSOLUTE counts 100 us (linux/v4l2-controls.h).
        ticks = round(cfg.exposure_ms * 10) if backend == cv2.CAP_V4L2 else cfg.exposure_ms
        wanted += [
            (cv2.CAP_PROP_AUTO_EXPOSURE, V4L2_MANUAL, "exposure_ms"),
            (cv2.CAP_PROP_EXPOSURE, ticks, "exposure_ms"),
        ]
    if cfg.gain is not None:
        wanted.append((cv2.CAP_PROP_GAIN, cfg.gain, "gain"))
    refused = []
    if backend != cv2.CAP_FFMPEG:
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    for control, value, name in wanted:
        if not capture.set(control, value) or abs(capture.get(control) - value) > TAKEN * max(value, 1.0):
            refused.append(f"{name}={value:g}: the driver has {capture.get(control):g}")
    return refused
