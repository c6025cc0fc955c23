"""Images from clips and folders."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Final

import cv2

from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import VisionError
from mkdaemon.reading import open_regular
from mkdaemon.vision.camera.capture import SizeWatch, captured_pixels, may_change_size, open_quietly, take_jpegs
from mkdaemon.vision.camera.image import EndOfImages, PictureError, Shot
from mkdaemon.vision.camera.imagecodec import read_picture

PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".pgm"})
CLIPS = frozenset({".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg", ".mpeg", ".ts"})
_BEGINNING: Final = re.compile(
    rb"RIFF.{4}AVI |.{4}(?:ftyp|moov|mdat|wide|free|skip|pnot)|\x1aE\xdf\xa3|\x00\x00\x01[\xb3\xba]"
    rb"|\x00?\x00\x00\x01[\x09\x27\x47\x67]|G.{187}G",
    re.DOTALL,
)
"""Of AVI, MP4 and QuickTime, Matroska, MPEG, bare H.264, and the transport stream."""
_LOOKED_AT: Final = 189
"""Length of the longest of them: a packet of the transport stream and the first byte of the next."""
FOLDER_HZ = 10.0


class ClipSource:
    """A video file at its own rate."""

    live = False

    def __init__(self, path: Path, cfg: CameraSection) -> None:
        self._path = path
        self._cfg = cfg
        self._capture: cv2.VideoCapture | None = None
        self._started: float | None = None
        self._coded = False
        self._watch: SizeWatch | None = None

    def open(self) -> tuple[str, ...]:
        """Open the clip."""
        if not self._path.is_file():
            msg = f"camera {self._cfg.name}: no such file: {self._path}"
            raise VisionError(msg)
        unread = f"camera {self._cfg.name}: {self._path} is no video OpenCV can read"
        if not _is_video(self._path):
            raise VisionError(unread)
        capture = open_quietly(str(self._path))
        if not capture.isOpened():
            raise VisionError(unread)
        self._capture, self._started = capture, None
        self._coded = take_jpegs(capture, cv2.CAP_FFMPEG)
        if self._cfg.watch_size and may_change_size(capture):
            self._watch = SizeWatch(str(self._path), capture)
        return ()

    def read(self, timeout: float) -> Shot | None:
        """Next image, in time."""
        if self._capture is None:
            raise EndOfImages
        good, image = self._capture.read()
        if not good and self._cfg.loop:
            self.close()
            self.open()
            good, image = self._capture.read()
        if not good:
            raise EndOfImages
        media = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
        if self._started is None:
            self._started = time.monotonic() - media
        if self._cfg.paced:
            time.sleep(max(self._started + media - time.monotonic(), 0.0))
        if self._watch is not None:
            self._watch.step()
            if self._watch.change:
                raise PictureError(self._watch.change)
        return Shot(captured_pixels(image, coded=self._coded), time.monotonic())

    def close(self) -> None:
        """Release the file."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None
        if self._watch is not None:
            self._watch.close()
            self._watch = None


def _is_video(path: Path) -> bool:
    """Whether a file begins as a video does: FFmpeg guesses at others for long, and follows lists to elsewhere."""
    try:
        with open_regular(path) as file:
            return _BEGINNING.match(file.read(_LOOKED_AT)) is not None
    except OSError:
        return False


class FolderSource:
    """The pictures of a folder in natural order, at `fps` or 10 Hz."""

    live = False

    def __init__(self, path: Path, cfg: CameraSection) -> None:
        self._path = path
        self._cfg = cfg
        self._files: list[Path] = []
        self._next = 0
        self._due = 0.0

    def open(self) -> tuple[str, ...]:
        """List the folder."""
        self._files = list_pictures(self._path)
        self._next, self._due = 0, time.monotonic()
        return ()

    def read(self, timeout: float) -> Shot | None:
        """Next picture."""
        if self._next >= len(self._files):
            if not self._cfg.loop:
                raise EndOfImages
            self._next = 0
        file = self._files[self._next]
        self._next += 1
        if self._cfg.paced:
            time.sleep(max(self._due - time.monotonic(), 0.0))
            self._due = max(self._due, time.monotonic() - 1.0) + 1.0 / (self._cfg.fps or FOLDER_HZ)
        try:
            return Shot(read_picture(file), time.monotonic())
        except OSError as error:
            msg = f"{file.name}: {error.strerror or error}"
            raise PictureError(msg) from error

    def close(self) -> None:
        """Nothing is held open."""


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
