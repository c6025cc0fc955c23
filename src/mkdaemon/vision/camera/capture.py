"""What OpenCV captures, as it is and not as OpenCV would have it.

OpenCV decodes motion JPEG in silence: damaged blocks stay in the image, and an image of another size than the first is
scaled to it. Its bytes are therefore taken as they come. Other codecs are left to OpenCV, which scales an H.264 or
H.265 stream that changes its size: `SizeWatch` sees that.
"""

from __future__ import annotations

import io
import os
import re
import threading
from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
import structlog

from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.camera.image import PictureError
from mkdaemon.vision.camera.imagecodec import decode_picture

MOTION_JPEG: Final = frozenset(cv2.VideoWriter.fourcc(*name) for name in ("MJPG", "mjpg", "JPEG", "jpeg"))
RAW: Final = (cv2.CAP_PROP_FORMAT, -1)
UNDECODED: Final = {cv2.CAP_V4L2: (cv2.CAP_PROP_CONVERT_RGB, 0), cv2.CAP_FFMPEG: RAW}
"""The property, and its value, that makes a backend give bytes (OpenCV, videoio flags)."""
TO_GREY: Final = {(): None, (1,): None, (3,): cv2.COLOR_BGR2GRAY, (4,): cv2.COLOR_BGRA2GRAY}
"""How OpenCV makes grey of a picture, by its channels."""
SIZED: Final = frozenset(
    cv2.VideoWriter.fourcc(*name)
    for name in ("H264", "h264", "X264", "x264", "AVC1", "avc1", "avc3", "HEVC", "hevc", "H265", "hvc1", "hev1")
) | {0x1B, 0x24, 7}
"""Codes of H.264 and H.265: four characters, or stream types of MPEG-TS (ISO/IEC 13818-1, table 2-34) and FLV."""
SIZE_SET: Final = re.compile(rb"\x00\x00\x01(?:[\x07\x27\x47\x67]|\x42\x01).*?(?=\x00\x00\x01|\Z)", re.DOTALL)
"""A sequence parameter set, in which the size stands: type 7 of H.264, type 33 of H.265's base layer (Annex B and
section 7.3.1 of both)."""
JOIN_TIME: Final = 1.0
"""How long closing waits for the second client [s]."""

_log = structlog.get_logger(__name__)


def open_quietly(
    address: str | io.BytesIO, backend: int = cv2.CAP_FFMPEG, options: Sequence[int] = ()
) -> cv2.VideoCapture:
    """Open without OpenCV and FFmpeg writing on the terminal: what failed is in our own sentence."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(address, backend, options)  # type: ignore[arg-type]  # the stubs know no streams
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


def may_change_size(capture: cv2.VideoCapture) -> bool:
    """Whether a capture decodes H.264 or H.265, whose size can be watched."""
    return round(capture.get(cv2.CAP_PROP_FOURCC)) in SIZED


class SizeWatch:
    """Whether an H.264 or H.265 stream changes the size of its pictures while it runs.

    OpenCV opens such a stream with one size, scales every later picture to it and says nothing: a tag would be measured
    with the wrong focal length. So a second reader takes the packets undecoded; a packet with new parameter sets is
    opened as a stream of its own, whose size FFmpeg tells. Of a file both readers go in step: a new size needs a
    picture that stands alone, before which all others are shown (ITU-T H.264, section 7.4.1.2.1).

    Args:
        address: of the stream.
        decoder: opened, which scales pictures to one size.
        options: of OpenCV's FFmpeg backend.
    """

    def __init__(self, address: str, decoder: cv2.VideoCapture, options: Sequence[int] = ()) -> None:
        self._address, self._options = address, options
        sides = _size(decoder)
        # the size as the stream has it, before pictures are turned
        is_turned = decoder.get(cv2.CAP_PROP_ORIENTATION_AUTO) and decoder.get(cv2.CAP_PROP_ORIENTATION_META) % 180
        self._opened = self._now = sides[::-1] if is_turned else sides
        self._sets: list[bytes] = []
        self._start()

    def _start(self) -> None:
        self._packets = open_quietly(self._address, options=[*self._options, *RAW])

    @property
    def change(self) -> str:
        """What differs, and what to do; empty while pictures have the size with which the stream was opened."""
        if self._now == self._opened:
            return ""
        (is_x, is_y), (was_x, was_y) = self._now, self._opened
        return (
            f"the stream's pictures have {is_x}x{is_y} and not {was_x}x{was_y}, with which it was opened:"
            " set the camera to one fixed resolution"
        )

    def step(self) -> bool:
        """Take the next packet of the stream; false when there is none."""
        good, packet = self._packets.read()
        sets = SIZE_SET.findall(packet.tobytes()) if good else []
        if sets and sets != self._sets:
            self._sets = sets
            size = _size(open_quietly(io.BytesIO(packet.tobytes())))
            self._now = size if all(size) else self._now
        return good

    def close(self) -> None:
        """Let go of the stream."""
        self._packets.release()


class LiveSizeWatch(SizeWatch):
    """The same of a network camera, in a thread, as a second client that decodes nothing; opened again when it ends.

    Args:
        pause: before it is opened again [s].
    """

    def __init__(self, address: str, decoder: cv2.VideoCapture, options: Sequence[int], pause: float) -> None:
        self._pause, self._stop = pause, threading.Event()
        self._thread = threading.Thread(target=self._run, name="size-watch", daemon=True)
        super().__init__(address, decoder, options)

    def _start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """End the thread; a stream that hangs is left behind, its thread does not keep the process alive."""
        self._stop.set()
        self._thread.join(JOIN_TIME)

    def _run(self) -> None:
        while not self._stop.is_set():
            super()._start()
            if not self._packets.isOpened():
                _log.warning("camera takes no second client: a change of its picture's size stays unseen")
            while not self._stop.is_set() and self.step():
                continue
            super().close()
            self._stop.wait(self._pause)


def _size(capture: cv2.VideoCapture) -> tuple[int, ...]:
    """Width and height [px]."""
    return tuple(round(capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
