r"""Frames of the MikroKopter serial line: ``# addr id payload c1 c2 CR``.

The payload is base64 over the 64 consecutive characters ``=`` to ``|`` with zero bytes for padding; the checksum is the
sum of all characters before it, modulo 4096, in two such characters. Source: docs/protocol.md, "Framing".

The low half of Adler-32 is one plus the byte sum modulo 65521 (RFC 1950), and a frame of at most `MAX_FRAME_CHARS`
characters of the alphabet sums to less: the C routine is an exact byte sum here.

The decoder is sans-IO: bytes in, frames and named losses out. It accepts any chunking, restarts at every ``#`` (boards
interrupt their own frames), tolerates plain text between frames, keeps a bounded buffer and never raises.
"""

from __future__ import annotations

from binascii import Error as BinasciiError
from binascii import a2b_base64, b2a_base64
from enum import StrEnum
from itertools import groupby
from typing import Final, NamedTuple
from zlib import adler32

from mkdaemon.errors import EncodeError

MAX_FRAME_CHARS: Final = 512
"""Longest frame accepted [characters]; the longest known reply (settings revision 108 and later) has 246."""

FRAME_OVERHEAD: Final = 6
"""Characters of a frame without payload: `#`, address, letter, two of the checksum, CR."""

_OVERHEAD: Final = FRAME_OVERHEAD - 1
"""The same without the CR, on which a received line has been split."""
_STANDARD: Final = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
_MODIFIED: Final = bytes(range(0x3D, 0x7D))
_SKIPPED: Final = b"\0"
"""Character that base64 decoding passes over."""
_TO_STANDARD: Final = bytes(_STANDARD[code - 0x3D] if 0x3D <= code <= 0x7C else _SKIPPED[0] for code in range(256))
_TO_MODIFIED: Final = bytes.maketrans(_STANDARD + b"=", _MODIFIED + b"=")
_IDLE: Final = b" \n\t\0"
_ADDRESS_BASE: Final = 0x61


class DropReason(StrEnum):
    """Reason for which bytes were dropped."""

    TEXT = "text"
    """Plain text outside any frame: boot banners, debug prints, escape sequences."""
    LENGTH = "length"
    """A frame cut short, interrupted by another `#`, not a whole number of character groups, or too long."""
    CHARACTERS = "characters"
    """A frame with a character outside the alphabet."""
    CHECKSUM = "checksum"
    """A frame whose checksum does not match."""
    EXPIRED = "expired"
    """A frame never sent: it waited for its turn until it was too old. No decoder says so."""


class Frame(NamedTuple):
    """One frame with a right checksum.

    Attributes:
        address: 0 any, 1 FlightCtrl, 2 NaviCtrl, 3 MK3Mag, 4 OSD, 5 BL-Ctrl; in a reply, the answering board.
        id: the command letter.
        payload: decoded bytes; a received payload is zero-padded to a multiple of three.
        raw: the frame as it stands on the wire, from `#` to CR.
    """

    address: int
    id: str
    payload: bytes
    raw: bytes


class Dropped(NamedTuple):
    """Bytes that did not become a frame, and why."""

    reason: DropReason
    raw: bytes


_new_frame: Final = tuple.__new__
"""`Frame` without its Python-level constructor, which takes twice as long."""


def encode_frame(address: int, command: str, payload: bytes = b"") -> bytes:
    """Build a frame.

    Args:
        address: 0..27; see `Frame.address`.
        command: one ASCII letter or `!`, `?`, `0`.
        payload: the whole structure; it is padded with zero bytes to a multiple of three.

    Raises:
        EncodeError: the address or the command letter cannot be framed, or the frame would be too long.
    """
    if not 0 <= address <= 27 or len(command) != 1 or not "!" <= command <= "~" or command == "#":
        msg = f"cannot frame command {command!r} for address {address}: one printable letter, address 0..27"
        raise EncodeError(msg)
    body = b2a_base64(payload + bytes(-len(payload) % 3), newline=False).translate(_TO_MODIFIED)
    head = b"#%c%b%b" % (_ADDRESS_BASE + address, command.encode("ascii"), body)
    if len(head) + 3 > MAX_FRAME_CHARS:
        msg = f"a payload of {len(payload)} bytes makes a frame over {MAX_FRAME_CHARS} characters"
        raise EncodeError(msg)
    total = (adler32(head) - 1) & 0xFFF
    return b"%b%c%c\r" % (head, 0x3D + (total >> 6), 0x3D + (total & 63))


def padded_length(size: int) -> int:
    """Length of a structure of `size` bytes once received: the next multiple of three [bytes]."""
    return size + -size % 3


class FrameDecoder:
    """Turns a byte stream into frames and named losses.

    Every byte fed is in exactly one result or was idle (carriage returns and white space between frames).
    """

    __slots__ = ("_rest",)

    def __init__(self) -> None:
        self._rest = b""

    @property
    def pending(self) -> int:
        """Bytes held back because their frame is not complete; at most `MAX_FRAME_CHARS`."""
        return len(self._rest)

    def feed(self, chunk: bytes) -> list[Frame | Dropped]:
        """Take the next bytes in order and return what they completed, in order."""
        out: list[Frame | Dropped] = []
        *lines, rest = (self._rest + chunk).split(b"\r")
        for line in lines:
            start = line.rfind(b"#")
            if start == 0:
                out.append(_parse(line))
            elif line:
                _take_line(line, start, out)
        if len(rest) > MAX_FRAME_CHARS:
            rest = self._shed(rest, out)
        self._rest = rest
        return out

    def flush(self) -> list[Frame | Dropped]:
        """Give up on an unfinished frame, for example when the port closes, and name what it held."""
        out: list[Frame | Dropped] = []
        rest, self._rest = self._rest, b""
        _drop_debris(rest, out)
        return out

    @staticmethod
    def _shed(rest: bytes, out: list[Frame | Dropped]) -> bytes:
        """Name the part of an overlong unfinished line that can no longer become a frame; keep the part that can."""
        start = rest.rfind(b"#")
        if start < 0 or len(rest) - start > MAX_FRAME_CHARS:
            _drop_debris(rest, out)
            return b""
        _drop_debris(rest[:start], out)
        return rest[start:]


def _take_line(line: bytes, start: int, out: list[Frame | Dropped]) -> None:
    """Take a line with something before its last `#`, or without any."""
    if start < 0:
        _drop_debris(line, out)
    else:
        _drop_debris(line[:start], out)
        out.append(_parse(line[start:]))


def _parse(line: bytes) -> Frame | Dropped:
    """Judge one line that begins with its only `#`, without the final CR."""
    size = len(line)
    if size < _OVERHEAD or (size - _OVERHEAD) & 3 or size >= MAX_FRAME_CHARS:
        return Dropped(DropReason.LENGTH, line + b"\r")
    high, low = line[-2], line[-1]
    total = (adler32(line) - 1 - high - low) & 0xFFF
    if high != 0x3D + (total >> 6) or low != 0x3D + (total & 63):
        return Dropped(_fault(line), line + b"\r")
    try:
        payload = a2b_base64(line[3:-2].translate(_TO_STANDARD))
    except BinasciiError:
        return Dropped(DropReason.CHARACTERS, line + b"\r")
    # Characters outside the alphabet were passed over, so they show in the length.
    if len(payload) << 2 != (size - _OVERHEAD) * 3 or not 0x61 <= line[1] <= 0x7C or not 0x21 <= line[2] <= 0x7E:
        return Dropped(DropReason.CHARACTERS, line + b"\r")
    return _new_frame(Frame, (line[1] - _ADDRESS_BASE, chr(line[2]), payload, line + b"\r"))


def _fault(line: bytes) -> DropReason:
    """Name what is wrong with a line whose checksum does not match: the plainest fault first."""
    if line[3:].translate(None, _MODIFIED) or not 0x61 <= line[1] <= 0x7C or not 0x21 <= line[2] <= 0x7E:
        return DropReason.CHARACTERS
    return DropReason.CHECKSUM


def _drop_debris(debris: bytes, out: list[Frame | Dropped]) -> None:
    """Name text and interrupted frames; white space alone is idle line, not a loss.

    Pieces too short for any frame are one loss together: a line full of `#` is no thousand frames.
    """
    text, *cut = debris.split(b"#")
    if text.strip(_IDLE):
        out.append(Dropped(DropReason.TEXT, text))
    for is_short, pieces in groupby(cut, key=lambda part: len(part) < _OVERHEAD - 1):
        if is_short:
            out.append(Dropped(DropReason.LENGTH, b"#" + b"#".join(pieces)))
        else:
            out.extend(Dropped(DropReason.LENGTH, b"#" + part) for part in pieces)
