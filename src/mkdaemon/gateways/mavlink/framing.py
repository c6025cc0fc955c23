"""Bytes to messages and back: frames of MAVLink 1 and 2, checksums, signatures.

Bytes are untrusted: what is no frame, fails its checksum or its signature is counted and dropped; nothing raises, and
no more than one frame is kept. Source: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from mkdaemon.gateways.mavlink.dialect import COMPONENT, Message, mavlink
from mkdaemon.gateways.mavlink.signing import SIGNATURE, Signing, signing_time

_HEADER = {0xFE: 6, 0xFD: 10}
MAGIC: Final = frozenset(_HEADER)
"""First byte of a frame of MAVLink 1 and 2."""
_SIGNED: Final = 1
MOST_BYTES: Final = 10 + 255 + 2 + SIGNATURE
"""Of a frame."""


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
    signature = SIGNATURE if header == 10 and rest[at + 2] & _SIGNED else 0
    return header + rest[at + 1] + 2 + signature
