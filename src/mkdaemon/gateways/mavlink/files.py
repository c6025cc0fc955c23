"""The file transfer protocol, to read: the few small files that the gateway itself makes.

Source: https://mavlink.io/en/services/ftp.html
"""

from __future__ import annotations

import struct
import zlib
from collections import OrderedDict
from collections.abc import Mapping
from enum import IntEnum
from typing import Final, NamedTuple

from mkdaemon.gateways.mavlink.dialect import Message, mavlink
from mkdaemon.gateways.mavlink.stations import Station

_HEAD: Final = struct.Struct("<HBBBBBxI")
_ROOM: Final = 239
"""Bytes of a file in one message."""
_BURST: Final = 40
"""Messages of a burst; the ground station asks for the next one."""
_MOST_SESSIONS: Final = 16


class Opcode(IntEnum):
    """What is asked for, and how it is answered; every other number is refused."""

    NONE = 0
    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN = 4
    READ = 5
    CHECKSUM = 14
    BURST = 15
    ACK = 128
    NAK = 129


class Error(IntEnum):
    """Why a request is refused."""

    INVALID_SESSION = 4
    END = 6
    UNKNOWN_COMMAND = 7
    NOT_FOUND = 10


class Request(NamedTuple):
    """A request.

    Attributes:
        sequence: its number.
        session: of an open file.
        opcode: what is asked for.
        offset: in a file [bytes], or in a folder.
        data: a path.
    """

    sequence: int
    session: int
    opcode: int
    offset: int
    data: bytes


def checksum(data: bytes) -> int:
    """CRC-32 as MAVLink counts it: of zero, and not inverted."""
    return zlib.crc32(data, 0xFFFF_FFFF) ^ 0xFFFF_FFFF


class FileServer:
    """Answers the protocol; nothing can be written.

    Attributes:
        files: content by name.
    """

    def __init__(self) -> None:
        self.files: Mapping[str, bytes] = {}
        self._open: OrderedDict[int, bytes] = OrderedDict()
        self._session = 0

    def take(self, station: Station, message: Message) -> None:
        """Answer a request."""
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, offset = _HEAD.unpack_from(payload)
        if opcode >= Opcode.ACK:
            return
        asked = Request(sequence, session, opcode, offset, payload[_HEAD.size :][:size])
        found = self._answer(asked)
        parts = [found] if isinstance(found, bytes | Error) else found
        for number, part in enumerate(parts, 1):
            is_refused = isinstance(part, Error)
            data = bytes([part]) if isinstance(part, Error) else part
            head = _HEAD.pack(
                (sequence + number) & 0xFFFF,
                self._session if opcode == Opcode.OPEN else session,
                Opcode.NAK if is_refused else Opcode.ACK,
                len(data),
                opcode,
                opcode == Opcode.BURST and number == len(parts),
                offset + _ROOM * (number - 1),
            )
            whose = (0, message.get_srcSystem(), message.get_srcComponent())
            station.send(mavlink.MAVLink_file_transfer_protocol_message(*whose, list((head + data).ljust(251, b"\0"))))

    def _answer(self, asked: Request) -> bytes | Error | list[bytes]:
        """Data of the answers, or why there is none."""
        match asked.opcode:
            case Opcode.NONE:
                return b""
            case Opcode.RESET:
                self._open.clear()
                return b""
            case Opcode.LIST:
                entries = [f"F{name}\t{len(data)}\0".encode() for name, data in self.files.items()][asked.offset :]
                return b"".join(entries) if entries else Error.END
            case Opcode.OPEN | Opcode.CHECKSUM:
                name = asked.data.rstrip(b"\0").decode("ascii", "replace").rpartition("/")[2]
                found = self.files.get(name)
                if found is None:
                    return Error.NOT_FOUND
                return self._opened(found) if asked.opcode == Opcode.OPEN else checksum(found).to_bytes(4, "little")
            case Opcode.TERMINATE | Opcode.READ | Opcode.BURST:
                return self._from_session(asked)
        return Error.UNKNOWN_COMMAND

    def _opened(self, data: bytes) -> bytes:
        self._session = (self._session + 1) % 256
        self._open[self._session] = data
        while len(self._open) > _MOST_SESSIONS:
            self._open.popitem(last=False)
        return len(data).to_bytes(4, "little")

    def _from_session(self, asked: Request) -> bytes | Error | list[bytes]:
        """What is asked of an open file."""
        data = self._open.get(asked.session)
        if data is None:
            return Error.INVALID_SESSION
        if asked.opcode == Opcode.TERMINATE:
            del self._open[asked.session]
            return b""
        end = min(len(data), asked.offset + _ROOM * (_BURST if asked.opcode == Opcode.BURST else 1))
        parts = [data[at : min(at + _ROOM, end)] for at in range(asked.offset, end, _ROOM)]
        return parts or Error.END
