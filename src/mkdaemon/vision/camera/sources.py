"""Sources of images: a driver, a network stream, a clip, a folder, a Zenoh key. One interface for all.

OpenCV leaves damaged blocks of motion JPEG in the image, and scales an image of another size to the first: its bytes
are taken as they come. Other codecs are left to OpenCV: such a camera has to keep its size.
"""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import cv2
import zenoh

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.foreignfiles import open_regular
from mkdaemon.telemetry.signature import Signature, private_key
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.camera.exposure import AUTO, MANUAL, TICK, V4l2Controls
from mkdaemon.vision.camera.image import EndOfImages, ImageSource, NewestSlot, PictureError, Shot
from mkdaemon.vision.camera.imagecodec import captured_pixels, read_picture, unpack

STRANGERS_LOOK: Final = 1.0
"""Time between two checks for foreign images [s]."""
PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".pgm"})
CLIPS = frozenset({".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg", ".mpeg", ".ts"})
FOLDER_HZ = 10.0
LATEST: Final = 1.0
"""A recorded picture that is later is due at once, and the next ones follow it [s]."""
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
TAKEN = 0.01
"""A setting was taken when the driver reads it back within this share."""
_WHAT_TO_CHECK = {
    cv2.CAP_V4L2: "is it a camera, and does another program hold it?",
    cv2.CAP_FFMPEG: "check address, user and password, and that the camera is on",
    cv2.CAP_GSTREAMER: "try the pipeline with gst-launch-1.0; it must end in appsink",
}
Sessions = Callable[[], zenoh.Session] | None
"""Gives the session of the bus; None where no bus is open."""
Recorded = tuple[float, Callable[[], Grey]]
"""A recorded picture: the pause from the one before [s], and what decodes its pixels, or raises PictureError."""


def source_of(cfg: CameraSection, session: Sessions = None) -> ImageSource:
    """Choose the source a configuration names; `session` gives the Zenoh session that `zenoh:` sources open by.

    Raises:
        ConfigError: nothing is known about such a source.
    """
    text = cfg.source
    scheme, _, rest = text.partition(":")
    if re.fullmatch(r"/dev/[\w/.:-]+", text):
        scheme, rest = "v4l2", text
    match scheme if rest else "":
        case "zenoh":
            return ZenohSource(rest, session, cfg.image_secret())
        case "folder":
            pause, folder = 1.0 / (cfg.fps or FOLDER_HZ), Path(rest)
            return PlayedSource(lambda: ((pause, partial(read_picture, file)) for file in list_pictures(folder)), cfg)
        case "file":
            return PlayedSource(partial(open_clip, Path(rest)), cfg)
        case "v4l2":
            return StreamSource(rest, cv2.CAP_V4L2, cfg)
        case "gstreamer":
            return StreamSource(rest, cv2.CAP_GSTREAMER, cfg)
        case "rtsp" | "rtsps" | "http" | "https" | "udp":
            return StreamSource(text, cv2.CAP_FFMPEG, cfg)
    msg = (
        f"camera {cfg.name}: source '{text}' is none of /dev/videoN, v4l2:PATH, rtsp://..., gstreamer:PIPELINE,"
        " file:CLIP, folder:DIR, zenoh:KEY"
    )
    raise ConfigError(msg)


class ZenohSource(ImageSource):
    """Images from a whole key on the bus: another machine's camera, or the simulator's.

    The sender signs them with the secret, which also gives the key; None takes all images.
    """

    def __init__(self, key: str, session: Sessions, secret: str | None) -> None:
        self._key, self._session, self._secret = key, session, secret
        self._clock = Clock()
        self._subscriber: zenoh.Subscriber[None] | None = None
        self._strangers: zenoh.Subscriber[Any] | None = None
        self._newest: NewestSlot[tuple[bytes, float]] = NewestSlot()
        self._look_at = 0.0

    def open(self) -> tuple[str, ...]:
        """Subscribe with a direct callback that only keeps the newest payload."""
        if self._session is None:
            raise VisionError("this source needs the bus: run it in the daemon")
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
        signature = Signature(self._key, payload, b"" if proof is None else proof.to_bytes())
        if self._secret is None or signature.is_by(self._secret):
            self._newest.put((payload, time.monotonic()))

    def read(self, timeout: float) -> Shot | None:
        """Newest image; a PictureError, at most once a second, if a program puts one to the plain key."""
        if self._strangers is not None and time.monotonic() >= self._look_at:
            self._look_at = time.monotonic() + STRANGERS_LOOK
            if self._strangers.handler.try_recv() is not None:
                msg = f"a program without the secret of this camera puts images to {self._key}: they are ignored"
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


class PlayedSource(ImageSource):
    """Recorded pictures in their time: `record` opens a clip or a folder, and raises VisionError where it cannot."""

    live = False

    def __init__(self, record: Callable[[], Iterator[Recorded]], cfg: CameraSection) -> None:
        self._record, self._cfg, self._due = record, cfg, -math.inf
        self._pictures: Iterator[Recorded] = iter(())

    def open(self) -> tuple[str, ...]:
        """Begin at its first picture."""
        self._pictures, self._due = self._record(), -math.inf
        return ()

    def read(self, timeout: float) -> Shot | None:
        """Next picture, in time."""
        picture = next(self._pictures, None)
        if picture is None and self._cfg.loop:
            self._pictures = self._record()
            picture = next(self._pictures, None)
        if picture is None:
            raise EndOfImages
        pause, decode = picture
        if self._cfg.paced:
            due, now = self._due + pause, time.monotonic()
            self._due = due if due > now - LATEST else now
            time.sleep(max(self._due - now, 0.0))
        return Shot(decode(), time.monotonic())

    def close(self) -> None:
        """Close the file."""
        self._pictures = iter(())


def list_pictures(folder: Path) -> list[Path]:
    """Pictures of a folder in natural order (2 before 10).

    Raises:
        VisionError: no such folder, or no picture in it.
    """
    if not folder.is_dir():
        msg = f"no such folder: {folder}"
        raise VisionError(msg)
    found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURES]
    if not found:
        msg = f"no pictures in {folder}: put {', '.join(sorted(PICTURES))} files there"
        raise VisionError(msg)
    return sorted(
        found, key=lambda path: [int(t) if t.isdecimal() else t for t in re.split(r"(\d+)", path.name.lower())]
    )


def open_clip(path: Path) -> Iterator[Recorded]:
    """Open a video file; its pictures, which decode when they are asked for.

    Raises:
        VisionError: there is none, or OpenCV cannot read it.
    """
    if not path.is_file():
        msg = f"no such file: {path}"
        raise VisionError(msg)
    capture = _open_quietly(str(path)) if _is_video(path) else None
    if capture is None or not capture.isOpened():
        msg = f"{path} is not a video OpenCV can read"
        raise VisionError(msg)
    _take_jpegs(capture, cv2.CAP_FFMPEG)
    return _clip(capture)


def _clip(capture: cv2.VideoCapture) -> Iterator[Recorded]:
    shown = 0.0
    while (image := capture.read()[1]) is not None:
        at = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
        yield at - shown, partial(captured_pixels, image)
        shown = at


def _is_video(path: Path) -> bool:
    """Whether a file begins as a video does: FFmpeg guesses at others for long, and follows lists to elsewhere."""
    try:
        with open_regular(path) as file:
            return _BEGINNING.match(file.read(_LOOKED_AT)) is not None
    except OSError:
        return False


def _open_quietly(address: str, backend: int = cv2.CAP_FFMPEG, options: Sequence[int] = ()) -> cv2.VideoCapture:
    """Open without OpenCV and FFmpeg writing on the terminal: what failed is in our own sentence."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        capture = cv2.VideoCapture(address, backend, options)
        # The lens is fixed to the sensor: what a phone writes of how it was held counts for nothing, as in photographs.
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        return capture
    finally:
        cv2.utils.logging.setLogLevel(level)


def _take_jpegs(capture: cv2.VideoCapture, backend: int) -> None:
    """Ask an opened capture of motion JPEG for its bytes."""
    if backend in UNDECODED and round(capture.get(cv2.CAP_PROP_FOURCC)) in MOTION_JPEG:
        capture.set(*UNDECODED[backend])


class StreamSource(ImageSource):
    """V4L2, GStreamer or a network stream through OpenCV."""

    def __init__(self, address: str, backend: int, cfg: CameraSection) -> None:
        self._address, self._backend, self._cfg = address, backend, cfg
        self._capture: cv2.VideoCapture | None = None

    def open(self) -> tuple[str, ...]:
        """Open and set size, rate, exposure and gain."""
        name, is_v4l2 = cv2.videoio_registry.getBackendName(self._backend), self._backend == cv2.CAP_V4L2
        if not cv2.videoio_registry.hasBackend(self._backend):
            msg = f"this OpenCV was built without {name}; use v4l2, rtsp or a Zenoh key"
            raise VisionError(msg)
        if is_v4l2 and not Path(self._address).exists():
            msg = f"{self._address} is not there: plug it in, or see /dev/v4l/by-id"
            raise VisionError(msg)
        if is_v4l2 and not os.access(self._address, os.R_OK | os.W_OK):
            msg = f"no permission for {self._address}: join the group video (usermod -aG video)"
            raise VisionError(msg)
        patience_ms = round(1000 * self._cfg.reopen_max)
        options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, patience_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, patience_ms]
        capture = _open_quietly(self._address, self._backend, options if self._backend == cv2.CAP_FFMPEG else ())
        if not capture.isOpened():
            msg = f"{name} cannot open {self._address}: {_WHAT_TO_CHECK[self._backend]}"
            raise VisionError(msg)
        self._capture = capture
        refused = self._set_controls(capture)
        _take_jpegs(capture, self._backend)
        if self._cfg.exposure_ms == "target":
            if is_v4l2:
                self.controls = V4l2Controls(Path(self._address), self._cfg.exposure_longest_ms / 1000.0)
                refused += self.controls.refused
            if self.controls is None or self.controls.reach is None:
                refused.append("exposure_ms=target: the driver does not allow to set the exposure")
        return tuple(refused)

    def _set_controls(self, capture: cv2.VideoCapture) -> list[str]:
        """Ask the driver for what the configuration wants; returns what it did not do."""
        cfg, exposure, mode = self._cfg, None, AUTO if self._cfg.exposure_ms == "auto" else None
        if isinstance(cfg.exposure_ms, float):
            mode = MANUAL
            exposure = round(1e-3 * cfg.exposure_ms / TICK) if self._backend == cv2.CAP_V4L2 else cfg.exposure_ms
        wanted = (
            (cv2.CAP_PROP_FRAME_WIDTH, cfg.width, "width"),
            (cv2.CAP_PROP_FRAME_HEIGHT, cfg.height, "height"),
            (cv2.CAP_PROP_FPS, cfg.fps, "fps"),
            (cv2.CAP_PROP_AUTO_EXPOSURE, mode, "exposure_ms"),
            (cv2.CAP_PROP_EXPOSURE, exposure, "exposure_ms"),
            (cv2.CAP_PROP_GAIN, cfg.gain, "gain"),
        )
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        # all are set before any is read back: OpenCV sets a width together with its height
        asked = [
            (control, value, name, capture.set(control, value)) for control, value, name in wanted if value is not None
        ]
        return [
            f"{name}={value:g}: the driver has {capture.get(control):g}"
            for control, value, name, good in asked
            if not good or abs(capture.get(control) - value) > TAKEN * max(value, 1.0)
        ]

    def read(self, timeout: float) -> Shot | None:
        """Block in the driver; OpenCV releases the GIL there."""
        image = self._capture.read()[1] if self._capture is not None else None
        arrived = time.monotonic()
        if self._capture is None or image is None:
            msg = f"{self._address} gives no more images"
            raise VisionError(msg)
        return Shot(captured_pixels(image), arrived, float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0)

    def close(self) -> None:
        """Release the device."""
        if self.controls is not None:
            self.controls.close()
        if self._capture is not None:
            self._capture.release()
        self.controls = self._capture = None
