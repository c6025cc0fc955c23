"""Bytes to messages and back: frames of MAVLink 1 and 2, checksums, signatures.

Bytes are untrusted: what is no frame, fails its checksum or its signature is counted and dropped; nothing raises, and
no more than one frame is kept. Source: https://mavlink.io/en/guide/serialization.html, message_signing.html.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from mkdaemon.gateways.mavlink.dialect import COMPONENT, Message, mavlink
from mkdaemon.gateways.mavlink.signingtimes import SigningTimes

_HEADER = {0xFE: 6, 0xFD: 10}
MAGIC: Final = frozenset(_HEADER)
"""First byte of a frame of MAVLink 1 and 2."""
_SIGNED: Final = 1
_SIGNATURE: Final = 13
MOST_BYTES: Final = 10 + 255 + 2 + _SIGNATURE
"""Of a frame."""
_EPOCH: Final = 1_420_070_400
"""Signatures count time from 2015-01-01 00:00 UTC [s; Unix time]."""
_LATE: Final = 60 * 100_000
"""Largest lag of a new stream behind our clock [10 us]."""
_MOST_STREAMS: Final = 64
"""Signed streams (link, system, component) that are remembered."""


@dataclass(slots=True)
class Counts:
    """What came on one link.

    Attributes:
        messages: taken.
        garbage: bytes that are no part of a frame.
        bad: frames with a wrong checksum, or of an unknown message.
        unsigned: frames without a right signature where one is asked for.
    """

    messages: int = 0
    garbage: int = 0
    bad: int = 0
    unsigned: int = 0


def signing_time(wall: float) -> int:
    """A system time as signatures count it [10 us].

    Args:
        wall: Unix time [s].
    """
    return int((wall - _EPOCH) * 100_000)


class Signing:
    """Signatures with one shared key: made, and checked; a frame that was heard once is not taken again.

    Attributes:
        key: 32 bytes.
    """

    def __init__(self, key: bytes, times: SigningTimes | None = None) -> None:
        """Sign and check.

        Args:
            key: 32 bytes.
            times: newest time of each stream, from the run before; None to begin without.
        """
        self.key = key
        self._newest = SigningTimes() if times is None else times

    def is_right(self, frame: bytes, wall: float) -> bool:
        """Whether a signed frame of MAVLink 2 has a right signature, and is newer than the last of its stream.

        Args:
            frame: with its signature.
            wall: Unix time [s].
        """
        made = hashlib.sha256(self.key + frame[:-6]).digest()[:6]
        if not hmac.compare_digest(made, frame[-6:]):
            return False
        stream = (frame[-_SIGNATURE], frame[5], frame[6])
        stamp = int.from_bytes(frame[-12:-6], "little")
        newest = self._newest.get(stream)
        if newest is None:
            if len(self._newest) >= _MOST_STREAMS or stamp + _LATE < signing_time(wall):
                return False
        elif stamp <= newest:
            return False
        self._newest.put(stream, stamp)
        return True


class Encoder:
    """Numbers, signs and packs messages for one link."""

    def __init__(self, system: int, signing: Signing | None, link_id: int = 0) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=COMPONENT)
        if signing is not None:
            self._mav.signing.secret_key = signing.key
            self._mav.signing.link_id = link_id
            self._mav.signing.sign_outgoing = True

    def encode(self, message: Message, wall: float) -> bytes:
        """The bytes of a message.

        Args:
            message: of the dialect.
            wall: Unix time, for the signature [s].
        """
        mav = self._mav
        if mav.signing.sign_outgoing:
            mav.signing.timestamp = max(mav.signing.timestamp, signing_time(wall))
        packed = bytes(message.pack(mav))
        mav.seq = (mav.seq + 1) % 256
        return packed


class Decoder:
    """Finds the messages in a stream of bytes."""

    def __init__(self, counts: Counts, signing: Signing | None) -> None:
        self.counts = counts
        self._signing = signing
        self._mav = mavlink.MAVLink(None)
        self._rest = bytearray()

    def feed(self, data: bytes, wall: float) -> Iterator[Message]:
        """The messages that are complete with these bytes.

        Args:
            data: as they came.
            wall: Unix time, for signatures [s].
        """
        self._rest += data
        at = 0
        rest = self._rest
        while at < len(rest):
            header = _HEADER.get(rest[at])
            if header is None:
                self.counts.garbage += 1
                at += 1
                continue
            if len(rest) - at < header:
                break
            length = _length(rest, at, header)
            if len(rest) - at < length:
                break
            message = self._message(bytes(rest[at : at + length]), wall)
            if message is None:
                at += 1
                continue
            at += length
            yield message
        del rest[:at]

    def datagram(self, data: bytes, wall: float) -> list[Message]:
        """The messages of a datagram; a frame never goes on in the next one.

        Args:
            data: the datagram.
            wall: Unix time, for signatures [s].
        """
        found = list(self.feed(data, wall))
        self.counts.garbage += len(self._rest)
        self._rest.clear()
        return found

    def _message(self, frame: bytes, wall: float) -> Message | None:
        """The message of a frame; None where it is none, or its signature is missing or wrong."""
        try:
            message = self._mav.decode(bytearray(frame))
        except (mavlink.MAVError, ValueError, struct.error):  # the last two by a field that pymavlink cannot unpack
            self.counts.bad += 1
            return None
        if message.get_msgId() < 0:  # an unknown message; its checksum cannot be checked
            self.counts.bad += 1
            return None
        if self._signing is not None and not (_is_signed(frame) and self._signing.is_right(frame, wall)):
            self.counts.unsigned += 1
            return None
        self.counts.messages += 1
        return message


def _is_signed(frame: bytes) -> bool:
    return frame[0] == 0xFD and bool(frame[2] & _SIGNED)


def _length(rest: bytearray, at: int, header: int) -> int:
    """Length of the frame that begins there."""
    signature = _SIGNATURE if header == 10 and rest[at + 2] & _SIGNED else 0
    return header + rest[at + 1] + 2 + signature


def key_from(text: str) -> bytes:
    """The key that a text stands for: 64 hexadecimal digits as they are, else the SHA-256 of a passphrase.

    Ground stations make their key of a passphrase in the same way.
    """
    word = text.strip()
    try:
        key = bytes.fromhex(word)
    except ValueError:
        key = b""
    return key if len(key) == 32 else hashlib.sha256(word.encode()).digest()


def float_bits(value: float) -> int:
    """The bits of a float of 32 bits as an unsigned number."""
    return int(struct.unpack("<I", struct.pack("<f", value))[0])
