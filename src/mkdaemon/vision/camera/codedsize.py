"""How large the pictures of an H.264 or H.265 stream are, from its parameter sets, without decoding a picture.

Sources: ITU-T H.264, sections 7.3.1, 7.3.2.1 and Annex B; ITU-T H.265, sections 7.3.1, 7.3.2.2 and 7.3.3.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

START: Final = re.compile(b"\x00\x00\x01")
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
    for unit in _units(packet):
        try:
            if unit[0] & H264_KIND == H264_SEQUENCE:
                sizes.append(_h264(_Bits(unit[1:])))
            elif unit[:2] == H265_SEQUENCE:
                sizes.append(_h265(_Bits(unit[2:])))
        except (ValueError, IndexError):
            continue
    return tuple(sizes)


def _units(packet: bytes) -> Iterator[bytes]:
    starts = [found.end() for found in START.finditer(packet)]
    for start, end in zip(starts, [*starts[1:], len(packet) + 3], strict=True):
        yield packet[start : end - 3]


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
