"""How large a picture is, from its header, before anything is decoded: a file of 130 kB may ask for a gigabyte.

Sources: PNG, RFC 2083, section 11.2.2; JPEG, ITU-T T.81, table B.2; BMP, BITMAPINFOHEADER of the Windows API; PNM,
netpbm(5); WebP, RFC 9649; TIFF 6.0, sections 2 and 8.
"""

from __future__ import annotations

import re
import struct
from typing import Final

MAX_PIXELS: Final = 64_000_000
"""Most pixels of a picture."""
_PNG: Final = b"\x89PNG\r\n\x1a\n"
JPEG: Final = b"\xff\xd8\xff"
_MARKER: Final = 0xFF
_STARTS_OF_FRAME: Final = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
_WITHOUT_LENGTH: Final = frozenset({0x01, *range(0xD0, 0xD9)})
_TIFF: Final = {b"II*\0": "<", b"MM\0*": ">"}
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_SHORT = 256, 257, 3
_PNM: Final = re.compile(rb"P[1-6](?:\s+|\s*#[^\n]*\n)+(\d{1,9})(?:\s+|\s*#[^\n]*\n)+(\d{1,9})\s")


def picture_size(content: bytes) -> tuple[int, int] | None:
    """Width and height that a picture claims [px].

    Args:
        content: PNG, JPEG, BMP, PNM, WebP or TIFF.

    Returns:
        The size; None where it is another format, or cut off.
    """
    try:
        if content.startswith(_PNG):
            return _pair(">II", content, 16)
        if content.startswith(JPEG):
            return _jpeg_size(content)
        if content.startswith(b"BM"):
            width, height = _pair("<ii", content, 18)
            return abs(width), abs(height)
        if content.startswith(b"RIFF"):
            return _webp_size(content)
        if content[:4] in _TIFF:
            return _tiff_size(content, _TIFF[content[:4]])
    except (struct.error, IndexError):
        return None
    found = _PNM.match(content[:4096])
    return (int(found[1]), int(found[2])) if found else None


def _jpeg_size(content: bytes) -> tuple[int, int] | None:
    at = 2
    while content[at] == _MARKER:
        marker = content[at + 1]
        if marker == _MARKER:  # fill bytes
            at += 1
        elif marker in _WITHOUT_LENGTH:
            at += 2
        elif marker in _STARTS_OF_FRAME:
            height, width = _pair(">HH", content, at + 5)
            return width, height
        else:
            at += 2 + int(struct.unpack_from(">H", content, at + 2)[0])
    return None


def _webp_size(content: bytes) -> tuple[int, int] | None:
    match content[8:16]:
        case b"WEBPVP8X":
            width, height = (int.from_bytes(content[at : at + 3], "little") + 1 for at in (24, 27))
            return width, height
        case b"WEBPVP8L":
            bits = int(struct.unpack_from("<I", content, 21)[0])
            return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
        case b"WEBPVP8 ":
            width, height = _pair("<HH", content, 26)
            return width & 0x3FFF, height & 0x3FFF
    return None


def _tiff_size(content: bytes, order: str) -> tuple[int, int] | None:
    first = int(struct.unpack_from(f"{order}I", content, 4)[0])
    count = int(struct.unpack_from(f"{order}H", content, first)[0])
    sizes: dict[int, int] = {}
    for at in range(first + 2, first + 2 + 12 * count, 12):
        tag, kind = _pair(f"{order}HH", content, at)
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT):
            form = "H" if kind == _TIFF_SHORT else "I"
            sizes[tag] = int(struct.unpack_from(order + form, content, at + 8)[0])
    return (sizes[_TIFF_WIDTH], sizes[_TIFF_HEIGHT]) if len(sizes) == 2 else None


def _pair(form: str, content: bytes, at: int) -> tuple[int, int]:
    first, second = struct.unpack_from(form, content, at)
    return int(first), int(second)
