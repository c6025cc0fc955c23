"""Whether an H.264 or H.265 stream changes the size of its pictures while it runs.

OpenCV opens such a stream with one size, scales every later picture to it and says nothing: a tag would be measured
with the wrong focal length. OpenCV's decoder does not hand out what it was given, so a second reader takes the packets
undecoded, in which the size stands. Of a file both readers go in step; of a network camera the second one is a second
client. Motion JPEG needs none of this: its pictures are decoded here (`captured`).

How large the pictures of an H.264 or H.265 stream are, from its parameter sets, without decoding a picture.

Sources: ITU-T H.264, sections 7.3.1, 7.3.2.1 and Annex B; ITU-T H.265, sections 7.3.1, 7.3.2.2 and 7.3.3.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import Final

import cv2
import structlog

START: Final = b"\x00\x00\x01"
"""Begins every unit of a byte stream."""
H264_KIND, H264_SEQUENCE = 0x9F, 7
"""Bits of a unit's first byte that tell its type, and what they are in a sequence parameter set."""
H265_SEQUENCE: Final = bytes([33 << 1, 1])
"""First bytes of such a set of H.265, of its base layer: type 33."""
MACROBLOCK: Final = 16
"""Side of a macroblock [px]."""
H264_FOUR_CHROMAS: Final = frozenset({100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135})
"""Profiles whose parameter set tells chroma, depths and scaling lists."""
SMALL_LIST: Final = 6
"""So many scaling lists have 16 values, later ones 64."""
LONGEST: Final = 4096
"""Of a parameter set so much is read [bytes]: all its lists take 2 kB, and what a stranger sends may be any length."""
_NOT_YET_8: Final = 8

Size = tuple[int, int]


class _Bits:
    """Reads a unit bit by bit."""

    def __init__(self, unit: bytes) -> None:
        content = unit[:LONGEST].replace(b"\x00\x00\x03", b"\x00\x00")  # emulation prevention
        self._value, self._left = int.from_bytes(content, "big"), 8 * len(content)

    def read(self, count: int) -> int:
        """The next `count` bits as a number; raises ValueError at the end."""
        self._left -= count
        if self._left < 0:
            msg = "a parameter set ends too early"
            raise ValueError(msg)
        return (self._value >> self._left) & ((1 << count) - 1)

    def golomb(self) -> int:
        """The next unsigned Exp-Golomb number."""
        zeros = 0
        while not self.read(1):
            zeros += 1
        return (1 << zeros) - 1 + self.read(zeros)

    def signed(self) -> int:
        """The next signed Exp-Golomb number."""
        code = self.golomb()
        return (code + 1) // 2 if code % 2 else -(code // 2)


def coded_sizes(packet: bytes) -> tuple[Size, ...]:
    """Sizes (width, height) [px] of all sequence parameter sets of a packet; empty where it holds none.

    Args:
        packet: units of H.264 or H.265 behind start codes (Annex B of both).
    """
    sizes: list[Size] = []
    for unit in packet.split(START)[1:]:
        try:
            if unit[0] & H264_KIND == H264_SEQUENCE:
                sizes.append(_h264(_Bits(unit[1:])))
            elif unit[:2] == H265_SEQUENCE:
                sizes.append(_h265(_Bits(unit[2:])))
        except (ValueError, IndexError):
            continue
    return tuple(sizes)


def _h264(bits: _Bits) -> Size:
    profile = bits.read(8)
    bits.read(16)
    bits.golomb()
    chroma, has_planes = 1, 0
    if profile in H264_FOUR_CHROMAS:
        chroma = bits.golomb()
        has_planes = bits.read(1) if chroma == 3 else 0
        bits.golomb(), bits.golomb(), bits.read(1)
        if bits.read(1):
            for number in range(8 if chroma != 3 else 12):
                if bits.read(1):
                    _skip_scaling(bits, 16 if number < SMALL_LIST else 64)
    bits.golomb()
    order = bits.golomb()
    if order == 0:
        bits.golomb()
    elif order == 1:
        bits.read(1), bits.signed(), bits.signed()
        for _ in range(bits.golomb()):
            bits.signed()
    bits.golomb(), bits.read(1)
    width, height = MACROBLOCK * (bits.golomb() + 1), MACROBLOCK * (bits.golomb() + 1)
    fields = 2 - bits.read(1)
    if fields == 2:
        bits.read(1)
    bits.read(1)
    grey = chroma == 0 or has_planes
    step_x = 1 if grey or chroma == 3 else 2
    step_y = (2 if chroma == 1 and not grey else 1) * fields
    left, right, top, bottom = _window(bits)
    return width - step_x * (left + right), height * fields - step_y * (top + bottom)


def _skip_scaling(bits: _Bits, count: int) -> None:
    last = following = _NOT_YET_8
    for _ in range(count):
        if following:
            following = (last + bits.signed()) % 256
        last = following or last


def _h265(bits: _Bits) -> Size:
    bits.read(4)
    layers = bits.read(3)
    bits.read(1 + 88 + 8)
    present = [(bits.read(1), bits.read(1)) for _ in range(layers)]
    if layers:
        bits.read(2 * (8 - layers))
    for has_profile, has_level in present:
        bits.read(88 * has_profile + 8 * has_level)
    bits.golomb()
    chroma = bits.golomb()
    if chroma == 3:
        bits.read(1)
    width, height = bits.golomb(), bits.golomb()
    step_x, step_y = (2 if chroma in (1, 2) else 1), (2 if chroma == 1 else 1)
    left, right, top, bottom = _window(bits)
    return width - step_x * (left + right), height - step_y * (top + bottom)


def _window(bits: _Bits) -> tuple[int, int, int, int]:
    """Left, right, top and bottom of what is cut off, in chroma samples."""
    if not bits.read(1):
        return 0, 0, 0, 0
    return bits.golomb(), bits.golomb(), bits.golomb(), bits.golomb()


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

    def read_packet(self, packets: cv2.VideoCapture) -> bool:
        """Take the next packet of the stream; false when there is none."""
        good, packet = packets.read()
        if good:
            self._now = next(iter(coded_sizes(packet.tobytes())), self._now)
        return good


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
        self.read_packet(self._packets)

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
            if not packets.isOpened():
                _log.warning("camera takes no second client: a change of its picture's size stays unseen")
            while not self._stop.is_set() and self.read_packet(packets):
                continue
            packets.release()
            self._stop.wait(self._pause)
