"""Other places for rendered images: a video file, a v4l2loopback device."""

from __future__ import annotations

import fcntl
import os
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import ConfigError

Grey = npt.NDArray[np.uint8]

VIDIOC_S_FMT: Final = 0xC0D05605
"""_IOWR('V', 5, struct v4l2_format) with its 208 bytes on 64-bit machines (linux/videodev2.h)."""
_OUTPUT: Final = 2
_FIELD_NONE: Final = 1
_GREY: Final = int.from_bytes(b"GREY", "little")
_SRGB: Final = 8


class FrameWriter(Protocol):
    """Takes every rendered image."""

    def write(self, pixels: Grey) -> None:
        """Take one image `(h, w)` uint8."""

    def close(self) -> None:
        """Finish; idempotent."""


class VideoWriter:
    """A video file; `.avi` and `.mkv` are lossless, everything else is compressed. It gets its name when it is closed.

    Raises:
        ConfigError: the file is there already, or cannot be written.
    """

    def __init__(self, path: Path, width: int, height: int, fps: float) -> None:
        lossless = path.suffix.lower() in {".avi", ".mkv"}
        code = cv2.VideoWriter.fourcc(*("FFV1" if lossless else "mp4v"))
        if path.exists():
            msg = f"sim.scene.video {path}: already exists; name another file, or remove it"
            raise ConfigError(msg)
        self._path, self._fresh = path, path.with_name(f".{path.stem}.new{path.suffix}")
        self._writer = cv2.VideoWriter(str(self._fresh), cv2.CAP_FFMPEG, code, fps, (width, height), isColor=False)
        if not self._writer.isOpened():
            msg = f"sim.scene.video {path}: cannot be written; use a folder that exists and .avi, .mkv or .mp4"
            raise ConfigError(msg)

    def write(self, pixels: Grey) -> None:
        """Append an image."""
        self._writer.write(pixels)

    def close(self) -> None:
        """Finish the file; idempotent."""
        self._writer.release()
        with suppress(FileNotFoundError):
            self._fresh.replace(self._path)


def loop_format(width: int, height: int) -> bytes:
    """A `struct v4l2_format` that announces grey images to a loop device; 208 bytes."""
    head = struct.pack("<I4x8I", _OUTPUT, width, height, _GREY, _FIELD_NONE, width, width * height, _SRGB, 0)
    return head.ljust(208, b"\0")


class LoopWriter:
    """A v4l2loopback device, which other programs read as a camera.

    Raises:
        ConfigError: there is no such device, or it takes no grey images.
    """

    def __init__(
        self, path: Path, width: int, height: int, *, ioctl: Callable[[int, int, bytes], object] = fcntl.ioctl
    ) -> None:
        self._device = -1
        try:
            self._device = os.open(path, os.O_WRONLY)
            ioctl(self._device, VIDIOC_S_FMT, loop_format(width, height))
        except OSError as error:
            self.close()
            msg = f"sim.scene.v4l2_loop {path}: {error.strerror or error}; load it with `modprobe v4l2loopback`"
            raise ConfigError(msg) from None

    def write(self, pixels: Grey) -> None:
        """Write an image; without a reader it is dropped."""
        if self._device >= 0:
            os.write(self._device, pixels.tobytes())

    def close(self) -> None:
        """Close the device."""
        if self._device >= 0:
            os.close(self._device)
            self._device = -1
