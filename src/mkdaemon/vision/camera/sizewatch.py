"""Whether an H.264 or H.265 stream changes the size of its pictures while it runs.

OpenCV opens such a stream with one size, scales every later picture to it and says nothing: a tag would be measured
with the wrong focal length. OpenCV's decoder does not hand out what it was given, so a second reader takes the packets
undecoded, in which the size stands. Of a file both readers go in step; of a network camera the second one is a second
client. Motion JPEG needs none of this: its pictures are decoded here (`captured`).
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import Final

import cv2
import structlog

from mkdaemon.vision.camera.codedsize import Size, coded_sizes

RAW: Final = (cv2.CAP_PROP_FORMAT, -1)
"""Makes OpenCV's FFmpeg backend give packets (OpenCV, videoio flags)."""
TAGS: Final = frozenset(
    cv2.VideoWriter.fourcc(*name)
    for name in ("H264", "h264", "X264", "x264", "AVC1", "avc1", "avc3", "HEVC", "hevc", "H265", "hvc1", "hev1")
) | {0x1B, 0x24, 7}
"""Codes of H.264 and H.265: four characters, or stream types of MPEG-TS (ISO/IEC 13818-1, table 2-34) and FLV."""
JOIN_TIME: Final = 1.0
"""How long closing waits for the second client [s]."""

_log = structlog.get_logger(__name__)


def open_quietly(opener: Callable[[], cv2.VideoCapture]) -> cv2.VideoCapture:
    """Open without OpenCV and FFmpeg writing on the terminal: what failed is in our own sentence."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return opener()
    finally:
        cv2.utils.logging.setLogLevel(level)


def may_change_size(capture: cv2.VideoCapture) -> bool:
    """Whether a capture decodes H.264 or H.265, whose size can be watched."""
    return round(capture.get(cv2.CAP_PROP_FOURCC)) in TAGS


def opened_size(capture: cv2.VideoCapture) -> Size:
    """Width and height [px] to which a capture scales every picture, as the stream has them before they are turned."""
    sides = round(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    is_turned = capture.get(cv2.CAP_PROP_ORIENTATION_AUTO) and round(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 180
    return (sides[1], sides[0]) if is_turned else sides


class SizeWatch:
    """The size of a stream's pictures, from its packets.

    Args:
        opened: size (width, height) to which the decoder scales them [px].
    """

    def __init__(self, opened: Size) -> None:
        self._opened = self._now = opened

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

    def packet_seen(self, packet: bytes) -> None:
        """Take the next packet of the stream."""
        sizes = coded_sizes(packet)
        if sizes:
            self._now = sizes[0]


class ClipWatch(SizeWatch):
    """The size of a file's pictures, read in step with its decoder.

    A new size needs a picture that stands alone, before which all others are shown: the number of packets is that of
    pictures there (ITU-T H.264, section 7.4.1.2.1).

    Args:
        path: of the file.
        opened: size to which the decoder scales them.
    """

    def __init__(self, path: str, opened: Size) -> None:
        super().__init__(opened)
        self._packets = open_quietly(lambda: cv2.VideoCapture(path, cv2.CAP_FFMPEG, [*RAW]))

    def step(self) -> None:
        """A picture was shown."""
        good, packet = self._packets.read()
        if good:
            self.packet_seen(packet.tobytes())

    def close(self) -> None:
        """Let go of the file."""
        self._packets.release()


class StreamWatch(SizeWatch):
    """The size of a network camera's pictures, as a second client that decodes nothing.

    Args:
        address: of the stream.
        opened: size to which the decoder scales them.
        options: of OpenCV's backend.
        pause: before it is opened again when it cannot be, or ends [s].
    """

    def __init__(self, address: str, opened: Size, options: list[int], pause: float) -> None:
        super().__init__(opened)
        self._address, self._options, self._pause = address, options, pause
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="size-watch", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread; a stream that hangs is left behind, its thread does not keep the process alive."""
        self._stop.set()
        self._thread.join(JOIN_TIME)

    def _run(self) -> None:
        while not self._stop.is_set():
            packets = open_quietly(lambda: cv2.VideoCapture(self._address, cv2.CAP_FFMPEG, [*self._options, *RAW]))
            if packets.isOpened():
                self._read(packets)
            else:
                _log.warning("camera takes no second client: a change of its picture's size stays unseen")
            packets.release()
            self._stop.wait(self._pause)

    def _read(self, packets: cv2.VideoCapture) -> None:
        while not self._stop.is_set():
            good, packet = packets.read()
            if not good:
                return
            self.packet_seen(packet.tobytes())
