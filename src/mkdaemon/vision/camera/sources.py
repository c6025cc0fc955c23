"""Where images come from: a driver, a network stream, a clip, a folder, a Zenoh key. One interface for all.

Exposure and gain of a V4L2 camera, by the kernel's own calls; they may be made while another program part streams.

Numbers and structures: linux/videodev2.h and linux/v4l2-controls.h. An exposure of `V4L2_CID_EXPOSURE_ABSOLUTE` counts
100 us. The unit of a gain is the driver's own: its range is taken for 1 to `GREATEST_GAIN`, and what that gets wrong
the next image shows.
"""

from __future__ import annotations

import errno
import fcntl
import math
import os
import re
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import zenoh

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.telemetry.signature import Signature, private_key
from mkdaemon.vision.camera.capture import LiveSizeWatch, captured_pixels, may_change_size, open_quietly, take_jpegs
from mkdaemon.vision.camera.exposure import Reach, Setting
from mkdaemon.vision.camera.files import CLIPS, ClipSource, FolderSource
from mkdaemon.vision.camera.image import PictureError, Shot, Source
from mkdaemon.vision.camera.imagecodec import unpack
from mkdaemon.vision.camera.slot import NewestSlot

QUERY: Final = 0xC0445624
"""VIDIOC_QUERYCTRL of a structure of 68 bytes."""
SET: Final = 0xC008561C
"""VIDIOC_S_CTRL of a structure of 8 bytes."""
EXPOSURE_AUTO, EXPOSURE_ABSOLUTE, EXPOSURE_AUTO_PRIORITY = 0x009A0901, 0x009A0902, 0x009A0903
AUTOGAIN, GAIN = 0x00980912, 0x00980913
NAMES: Final = {
    EXPOSURE_AUTO: "exposure_auto",
    EXPOSURE_ABSOLUTE: "exposure_absolute",
    EXPOSURE_AUTO_PRIORITY: "exposure_auto_priority",
    AUTOGAIN: "autogain",
    GAIN: "gain",
}
MANUAL, AUTO = 1, 3
"""Of V4L2_CID_EXPOSURE_AUTO: manual and aperture priority."""
QUERIED: Final = "=II32siiiiIII"
"""struct v4l2_queryctrl: id, type, name, minimum, maximum, step, default_value, flags, reserved[2]."""
UNSETTABLE: Final = 0x0001 | 0x0004
"""V4L2_CTRL_FLAG_DISABLED, V4L2_CTRL_FLAG_READ_ONLY."""
GONE: Final = frozenset({errno.ENODEV, errno.ENXIO})
"""What the kernel says of a device that was unplugged while it is open. EBUSY, EACCES, EINVAL, ERANGE and EIO are a
control's: images go on."""
TICK: Final = 100e-6
GREATEST_GAIN: Final = 16.0
"""Analogue gain of the OV9281, registers 0x10 to 0xff (Linux, drivers/media/i2c/ov9282.c)."""


class Range(NamedTuple):
    """Of one control, in the driver's unit."""

    least: int
    greatest: int


class V4l2Controls:
    """Exposure and gain of one device; `refused` is what the driver did not let us take over from it.

    Raises:
        VisionError: the device is gone, or cannot be opened.
    """

    def __init__(self, device: Path) -> None:
        self._device = device
        try:
            self._descriptor = os.open(device, os.O_RDWR | os.O_NONBLOCK)
        except OSError as error:
            msg = f"{device} cannot be opened a second time, to set its exposure: {error.strerror}"
            raise VisionError(msg) from None
        try:
            self.refused = self._take_over()
        except VisionError:
            self.close()
            raise

    @property
    def reach(self) -> Reach | None:
        """What the camera can be told; none where its exposure cannot be set."""
        if self._exposure is None:
            return None
        gain = GREATEST_GAIN if self._gain is not None and self._gain.greatest > self._gain.least else 1.0
        return Reach(max(self._exposure.least, 1) * TICK, self._exposure.greatest * TICK, gain)

    def adjust(self, setting: Setting) -> tuple[str, ...]:
        """Tell the camera; returns what it refused this time.

        Raises:
            VisionError: the device is gone.
        """
        refused: list[str] = []
        if self._exposure is not None:
            ticks = round(setting.exposure / TICK)
            refused += self._set(EXPOSURE_ABSOLUTE, min(max(ticks, self._exposure.least, 1), self._exposure.greatest))
        if self._gain is not None:
            span = self._gain.greatest - self._gain.least
            refused += self._set(GAIN, self._gain.least + round(span * (setting.gain - 1.0) / (GREATEST_GAIN - 1.0)))
        return tuple(refused)

    def close(self) -> None:
        """Let go of the device; its settings stay."""
        os.close(self._descriptor)

    def _take_over(self) -> tuple[str, ...]:
        """Switch the camera's own exposure and gain off; what it keeps for itself is not ours to set."""
        self._exposure, self._gain = self._query(EXPOSURE_ABSOLUTE), self._query(GAIN)
        if self._exposure is None:
            return ()
        stays_auto = self._switch_off(EXPOSURE_AUTO, MANUAL)
        if stays_auto:
            self._exposure = self._gain = None
            return stays_auto
        own_gain = self._switch_off(AUTOGAIN, 0)
        if own_gain:
            self._gain = None
        return (*self._switch_off(EXPOSURE_AUTO_PRIORITY, 0), *own_gain)

    def _switch_off(self, control: int, value: int) -> tuple[str, ...]:
        return self._set(control, value) if self._query(control) is not None else ()

    def _query(self, control: int) -> Range | None:
        """Range of a control that can be set; a busy or inactive one counts, as it may become free."""
        content = bytearray(struct.pack(QUERIED, control, 0, b"", 0, 0, 0, 0, 0, 0, 0))
        try:
            fcntl.ioctl(self._descriptor, QUERY, content)
        except OSError as error:
            self._raise_if_gone(error)
            return None
        _, _, _, least, greatest, _, _, flags, *_ = struct.unpack(QUERIED, content)
        return None if flags & UNSETTABLE else Range(least, greatest)

    def _set(self, control: int, value: int) -> tuple[str, ...]:
        """Set a control; what and why, where the driver refuses."""
        try:
            fcntl.ioctl(self._descriptor, SET, bytearray(struct.pack("=Ii", control, value)))
        except OSError as error:
            self._raise_if_gone(error)
            return (f"{NAMES[control]}={value}: the driver says {error.strerror}",)
        return ()

    def _raise_if_gone(self, error: OSError) -> None:
        if error.errno in GONE:
            msg = f"{self._device} is gone ({error.strerror}): plug it in"
            raise VisionError(msg) from None


STRANGERS_LOOK: Final = 1.0
"""Time between two looks for images of somebody else [s]."""
TAKEN = 0.01
"""A setting was taken when the driver reads it back within this share."""
SHORT_LIFE, JEALOUS_FROM = 5.0, 2
"""A stream that ends within so long [s], so often in a row, may be of a camera that drops a client for the next one."""
SCHEMES: Final = ("zenoh", "folder", "file", "gstreamer", "v4l2", "rtsp", "rtsps", "http", "https", "udp")
_WHAT_TO_CHECK = {
    cv2.CAP_V4L2: "is it a camera, and does another program hold it?",
    cv2.CAP_FFMPEG: "check address, user and password, and that the camera is on",
    cv2.CAP_GSTREAMER: "try the pipeline with gst-launch-1.0; it must end in appsink",
}


def source_of(cfg: CameraSection, session: Callable[[], zenoh.Session] | None = None) -> Source:
    """Choose the source a configuration names; `session` gives the Zenoh session for `zenoh:` sources.

    Raises:
        ConfigError: nothing is known about such a source.
    """
    text = cfg.source
    scheme, _, rest = text.partition(":")
    if not rest or scheme not in SCHEMES:
        path = Path(text)
        is_device, is_clip = re.fullmatch(r"/dev/[\w/.:-]+", text), path.suffix.lower() in CLIPS
        scheme = "v4l2" if is_device else "folder" if path.is_dir() else "file" if is_clip else ""
        rest = text
    match scheme:
        case "zenoh" if session is not None:
            return ZenohSource(rest, session, cfg.image_secret())
        case "zenoh":
            msg = f"camera {cfg.name}: source '{text}' needs the bus; run it in the daemon"
        case "folder":
            return FolderSource(Path(rest), cfg)
        case "file":
            return ClipSource(Path(rest), cfg)
        case "gstreamer" | "v4l2":
            return StreamSource(rest, cv2.CAP_V4L2 if scheme == "v4l2" else cv2.CAP_GSTREAMER, cfg)
        case "":
            msg = (
                f"camera {cfg.name}: source '{text}' is none of /dev/videoN, v4l2:PATH, rtsp://..., gstreamer:PIPELINE,"
                " file:CLIP, folder:DIR, zenoh:KEY"
            )
        case _:
            return StreamSource(text, cv2.CAP_FFMPEG, cfg)
    raise ConfigError(msg)


class ZenohSource:
    """Images from a key on the bus: another machine's camera, or the simulator's.

    Args:
        key: plain and whole.
        session: gives an open one.
        secret: with which the sender signs them, and without which nobody knows the key they come to; None takes
            images from whoever puts them.
    """

    live = True

    def __init__(self, key: str, session: Callable[[], zenoh.Session], secret: str | None = None) -> None:
        self._key, self._session, self._secret = key, session, secret
        self._clock = Clock()
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._strangers: zenoh.Subscriber[Any] | None = None
        self._newest: NewestSlot[tuple[bytes, float]] = NewestSlot()
        self._look_at = 0.0

    def open(self) -> tuple[str, ...]:
        """Subscribe with a direct callback that only keeps the newest payload."""
        try:
            session, secret = self._session(), self._secret
            key = self._key if secret is None else private_key(secret, self._key)
            self._subscriber = session.declare_subscriber(key, zenoh.handlers.Callback(self._on_sample, indirect=False))
            if secret is not None:  # kept without Python, the newest alone
                self._strangers = session.declare_subscriber(self._key, zenoh.handlers.RingChannel(1))
        except zenoh.ZError as error:
            msg = f"zenoh:{self._key}: {str(error).partition(' at ')[0]}"
            raise VisionError(msg) from error
        return ()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        payload, proof = sample.payload.to_bytes(), sample.attachment
        if self._secret is not None:
            signature = Signature(self._key, payload, b"" if proof is None else proof.to_bytes())
            if not signature.is_by(self._secret):
                return
        self._newest.put((payload, time.monotonic()))

    def read(self, timeout: float) -> Shot | None:
        """Newest image; a PictureError, once a second at most, where somebody put one to the plain key."""
        if self._strangers is not None and time.monotonic() >= self._look_at:
            self._look_at = time.monotonic() + STRANGERS_LOOK
            if self._strangers.handler.try_recv() is not None:
                msg = f"somebody without the secret of this camera puts images to {self._key}: they are not looked at"
                raise PictureError(msg)
        taken = self._newest.take(timeout)
        if taken is None:
            return None
        payload, arrived = taken
        frame, pixels = unpack(payload)
        return Shot(pixels, arrived, self._clock.monotonic_of(frame.stamp), "header", frame.sequence)

    def close(self) -> None:
        """End the subscriptions."""
        for subscriber in filter(None, (self._strangers, self._subscriber)):
            subscriber.undeclare()  # type: ignore[no-untyped-call]
        self._strangers = self._subscriber = None


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
        self._watch: LiveSizeWatch | None = None
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
        capture = open_quietly(self._address, self._backend, options if self._backend == cv2.CAP_FFMPEG else ())
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
            self._watch = LiveSizeWatch(self._address, capture, options, self._cfg.reopen_max)
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
        for held in (self._watch, self._controls):
            if held is not None:
                held.close()
        if self._capture is not None:
            self._capture.release()
        self._watch = self._controls = self._capture = None


def _set_controls(capture: cv2.VideoCapture, cfg: CameraSection, backend: int) -> list[str]:
    """Ask the driver for what the configuration wants; returns what it did not do."""
    wanted: list[tuple[int, float, str]] = []
    if cfg.width is not None and cfg.height is not None:
        wanted += [(cv2.CAP_PROP_FRAME_WIDTH, cfg.width, "width"), (cv2.CAP_PROP_FRAME_HEIGHT, cfg.height, "height")]
    if cfg.fps is not None:
        wanted.append((cv2.CAP_PROP_FPS, cfg.fps, "fps"))
    if cfg.exposure_ms == "auto":
        wanted.append((cv2.CAP_PROP_AUTO_EXPOSURE, AUTO, "exposure_ms"))
    elif isinstance(cfg.exposure_ms, float):
        # V4L2_CID_EXPOSURE_ABSOLUTE counts 100 us (linux/v4l2-controls.h).
        ticks = round(cfg.exposure_ms * 10) if backend == cv2.CAP_V4L2 else cfg.exposure_ms
        wanted += [
            (cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL, "exposure_ms"),
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
