"""What OpenCV captures, as it is and not as OpenCV would have it: clips, network streams, V4L2 cameras.

OpenCV decodes motion JPEG in silence: damaged blocks stay in the image, and an image of another size than the first is
scaled to it. Its bytes are therefore taken as they come. Other codecs are left to OpenCV: such a camera has to keep its
size.

Exposure and gain of a V4L2 camera, by the kernel's own calls; they may be made while another program part streams.
Numbers and structures: linux/videodev2.h and linux/v4l2-controls.h. An exposure of `V4L2_CID_EXPOSURE_ABSOLUTE` counts
100 us. The unit of a gain is the driver's own: its range is taken for 1 to `GREATEST_GAIN`, and what that gets wrong
the next image shows.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import struct
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import VisionError
from mkdaemon.reading import open_regular
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.camera.exposure import Reach, Setting
from mkdaemon.vision.camera.image import PictureError, Recorded, Shot
from mkdaemon.vision.camera.imagecodec import decode_picture

CLIPS = frozenset({".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg", ".mpeg", ".ts"})
_BEGINNING: Final = re.compile(
    rb"RIFF.{4}AVI |.{4}(?:ftyp|moov|mdat|wide|free|skip|pnot)|\x1aE\xdf\xa3|\x00\x00\x01[\xb3\xba]"
    rb"|\x00?\x00\x00\x01[\x09\x27\x47\x67]|G.{187}G",
    re.DOTALL,
)
"""Of AVI, MP4 and QuickTime, Matroska, MPEG, bare H.264, and the transport stream."""
_LOOKED_AT: Final = 189
"""Length of the longest of them: a packet of the transport stream and the first byte of the next."""
MOTION_JPEG: Final = frozenset(cv2.VideoWriter.fourcc(*name) for name in ("MJPG", "mjpg", "JPEG", "jpeg"))
UNDECODED: Final = {cv2.CAP_V4L2: (cv2.CAP_PROP_CONVERT_RGB, 0), cv2.CAP_FFMPEG: (cv2.CAP_PROP_FORMAT, -1)}
"""The property, and its value, that makes a backend give bytes (OpenCV, videoio flags)."""
TO_GREY: Final = {(): None, (1,): None, (3,): cv2.COLOR_BGR2GRAY, (4,): cv2.COLOR_BGRA2GRAY}
"""How OpenCV makes grey of a picture, by its channels."""
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
TAKEN = 0.01
"""A setting was taken when the driver reads it back within this share."""
_WHAT_TO_CHECK = {
    cv2.CAP_V4L2: "is it a camera, and does another program hold it?",
    cv2.CAP_FFMPEG: "check address, user and password, and that the camera is on",
    cv2.CAP_GSTREAMER: "try the pipeline with gst-launch-1.0; it must end in appsink",
}


def open_quietly(address: str, backend: int = cv2.CAP_FFMPEG, options: Sequence[int] = ()) -> cv2.VideoCapture:
    """Open without OpenCV and FFmpeg writing on the terminal: what failed is in our own sentence."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(address, backend, options)
    finally:
        cv2.utils.logging.setLogLevel(level)


def take_jpegs(capture: cv2.VideoCapture, backend: int) -> bool:
    """Ask an opened capture of motion JPEG for its bytes; false where it decodes."""
    if backend not in UNDECODED or round(capture.get(cv2.CAP_PROP_FOURCC)) not in MOTION_JPEG:
        return False
    return bool(capture.set(*UNDECODED[backend]))


def captured_pixels(image: npt.NDArray[np.generic], *, coded: bool) -> Grey:
    """Grey values `(h, w)` uint8 of what a capture has read: pixels of 8 or 16 bits, or, `coded`, bytes in one row.

    Raises:
        PictureError: no picture, or a damaged one.
    """
    if coded:
        return decode_picture(image.tobytes())
    pixels = (image.astype(np.uint16) >> 8).astype(np.uint8) if image.dtype == np.uint16 else image
    channels = pixels.shape[2:]
    if pixels.dtype != np.uint8 or pixels.size == 0 or pixels.ndim < 2 or channels not in TO_GREY:
        msg = f"no picture: {image.dtype} {image.shape}"
        raise PictureError(msg)
    code = TO_GREY[channels]
    grey = pixels if code is None else cv2.cvtColor(np.asarray(pixels, dtype=np.uint8), code)
    return np.ascontiguousarray(grey.reshape(grey.shape[:2]), dtype=np.uint8)


def open_clip(path: Path) -> Iterator[Recorded]:
    """Open a video file; its pictures, which decode when they are asked for.

    Raises:
        VisionError: there is none, or OpenCV cannot read it.
    """
    if not path.is_file():
        msg = f"no such file: {path}"
        raise VisionError(msg)
    capture = open_quietly(str(path)) if _is_video(path) else None
    if capture is None or not capture.isOpened():
        msg = f"{path} is no video OpenCV can read"
        raise VisionError(msg)
    return _clip(capture)


def _clip(capture: cv2.VideoCapture) -> Iterator[Recorded]:
    coded, shown = take_jpegs(capture, cv2.CAP_FFMPEG), 0.0
    while (image := capture.read()[1]) is not None:
        at = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
        yield Recorded(at - shown, partial(captured_pixels, image, coded=coded))
        shown = at


def _is_video(path: Path) -> bool:
    """Whether a file begins as a video does: FFmpeg guesses at others for long, and follows lists to elsewhere."""
    try:
        with open_regular(path) as file:
            return _BEGINNING.match(file.read(_LOOKED_AT)) is not None
    except OSError:
        return False


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
        if self._ask(QUERY, content):
            return None
        _, _, _, least, greatest, _, _, flags, *_ = struct.unpack(QUERIED, content)
        return None if flags & UNSETTABLE else Range(least, greatest)

    def _set(self, control: int, value: int) -> tuple[str, ...]:
        """Set a control; what and why, where the driver refuses."""
        fault = self._ask(SET, bytearray(struct.pack("=Ii", control, value)))
        return (f"{NAMES[control]}={value}: the driver says {fault}",) if fault else ()

    def _ask(self, request: int, content: bytearray) -> str:
        """Ask the kernel, which answers in `content`; why it refuses, empty where it does not."""
        try:
            fcntl.ioctl(self._descriptor, request, content)
        except OSError as error:
            if error.errno in GONE:
                msg = f"{self._device} is gone ({error.strerror}): plug it in"
                raise VisionError(msg) from None
            return str(error.strerror)
        return ""


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
            msg = f"this OpenCV was built without {name}; use v4l2, rtsp or a Zenoh key"
            raise VisionError(msg)
        if self._backend == cv2.CAP_V4L2:
            self._check_device()
        patience_ms = round(1000 * self._cfg.reopen_max)
        options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, patience_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, patience_ms]
        capture = open_quietly(self._address, self._backend, options if self._backend == cv2.CAP_FFMPEG else ())
        if not capture.isOpened():
            msg = f"{name} cannot open {self._address}: {_WHAT_TO_CHECK[self._backend]}"
            raise VisionError(msg)
        self._capture = capture
        refused = _set_controls(capture, self._cfg, self._backend)
        self._coded = take_jpegs(capture, self._backend)
        if self._cfg.exposure_ms == "target":
            if self._backend == cv2.CAP_V4L2:
                self._controls = V4l2Controls(Path(self._address))
                refused += self._controls.refused
            if self.reach is None:
                refused.append("exposure_ms=target: the driver lets nobody set the exposure")
        return tuple(refused)

    def _check_device(self) -> None:
        """Say what OpenCV does not: the device is missing, or belongs to others."""
        if not Path(self._address).exists():
            msg = f"{self._address} is not there: plug it in, or see /dev/v4l/by-id"
            raise VisionError(msg)
        if not os.access(self._address, os.R_OK | os.W_OK):
            msg = f"no permission for {self._address}: join the group video (usermod -aG video)"
            raise VisionError(msg)

    def read(self, timeout: float) -> Shot | None:
        """Block in the driver; OpenCV releases the GIL there."""
        capture = self._capture
        good, image = capture.read() if capture is not None else (False, None)
        arrived = time.monotonic()
        if capture is None or not good or image is None:
            msg = f"{self._address} gives no more images"
            raise VisionError(msg)
        pixels = captured_pixels(image, coded=self._coded)
        stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
        return Shot(pixels, arrived, stamp if stamp > 0.0 else None)

    def close(self) -> None:
        """Release the device."""
        if self._controls is not None:
            self._controls.close()
        if self._capture is not None:
            self._capture.release()
        self._controls = self._capture = None


def _set_controls(capture: cv2.VideoCapture, cfg: CameraSection, backend: int) -> list[str]:
    """Ask the driver for what the configuration wants; returns what it did not do."""
    is_sized = cfg.width is not None and cfg.height is not None
    exposure = cfg.exposure_ms if isinstance(cfg.exposure_ms, float) else None
    mode = MANUAL if exposure is not None else AUTO if cfg.exposure_ms == "auto" else None
    # V4L2_CID_EXPOSURE_ABSOLUTE counts 100 us (linux/v4l2-controls.h).
    ticks = round(exposure * 10) if exposure is not None and backend == cv2.CAP_V4L2 else exposure
    wanted = (
        (cv2.CAP_PROP_FRAME_WIDTH, cfg.width if is_sized else None, "width"),
        (cv2.CAP_PROP_FRAME_HEIGHT, cfg.height if is_sized else None, "height"),
        (cv2.CAP_PROP_FPS, cfg.fps, "fps"),
        (cv2.CAP_PROP_AUTO_EXPOSURE, mode, "exposure_ms"),
        (cv2.CAP_PROP_EXPOSURE, ticks, "exposure_ms"),
        (cv2.CAP_PROP_GAIN, cfg.gain, "gain"),
    )
    refused = []
    if backend != cv2.CAP_FFMPEG:
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    for control, value, name in wanted:
        if value is None:
            continue
        if not capture.set(control, value) or abs(capture.get(control) - value) > TAKEN * max(value, 1.0):
            refused.append(f"{name}={value:g}: the driver has {capture.get(control):g}")
    return refused
