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
from mkdaemon.gateways.mavlink.stations import Program, Station

_HEAD: Final = struct.Struct("<HBBBBBxI")
_ROOM: Final = 239
"""Bytes of a file in one message."""
_BURST: Final = 40
"""Messages of a burst; the ground station asks for the next one."""
_MOST_OPEN: Final = 16
_SESSION: Final = 0
"""Of every program; it has one file open at a time. MAVSDK 4.1 asks for session 0, whatever the answer said."""


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
        self._open: OrderedDict[tuple[Station, Program], bytes] = OrderedDict()

    def take(self, station: Station, message: Message) -> None:
        """Answer a request."""
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, offset = _HEAD.unpack_from(payload)
        if opcode >= Opcode.ACK:
            return
        asked = Request(sequence, session, opcode, offset, payload[_HEAD.size :][:size])
        program = Program(message.get_srcSystem(), message.get_srcComponent())
        found = self._answer((station, program), asked)
        parts = [found] if isinstance(found, bytes | Error) else found
        for number, part in enumerate(parts, 1):
            is_refused = isinstance(part, Error)
            data = bytes([part]) if isinstance(part, Error) else part
            head = _HEAD.pack(
                (sequence + number) & 0xFFFF,
                session,
                Opcode.NAK if is_refused else Opcode.ACK,
                len(data),
                opcode,
                opcode == Opcode.BURST and number == len(parts),
                offset + _ROOM * (number - 1),
            )
            whose = (0, message.get_srcSystem(), message.get_srcComponent())
            station.send(mavlink.MAVLink_file_transfer_protocol_message(*whose, list((head + data).ljust(251, b"\0"))))

    def _answer(self, whose: tuple[Station, Program], asked: Request) -> bytes | Error | list[bytes]:
        """Data of the answers, or why there is none."""
        match asked.opcode:
            case Opcode.NONE:
                return b""
            case Opcode.RESET:
                self._open.pop(whose, None)
                return b""
            case Opcode.LIST:
                entries = [f"F{name}\t{len(data)}\0".encode() for name, data in self.files.items()][asked.offset :]
                return b"".join(entries) if entries else Error.END
            case Opcode.OPEN | Opcode.CHECKSUM:
                name = asked.data.rstrip(b"\0").decode("ascii", "replace").rpartition("/")[2]
                found = self.files.get(name)
                if found is None:
                    return Error.NOT_FOUND
                if asked.opcode == Opcode.CHECKSUM:
                    return checksum(found).to_bytes(4, "little")
                self._open[whose] = found
                while len(self._open) > _MOST_OPEN:
                    self._open.popitem(last=False)
                return len(found).to_bytes(4, "little")
            case Opcode.TERMINATE | Opcode.READ | Opcode.BURST:
                return self._from_session(whose, asked)
        return Error.UNKNOWN_COMMAND

    def _from_session(self, whose: tuple[Station, Program], asked: Request) -> bytes | Error | list[bytes]:
        """What is asked of an open file."""
        data = self._open.get(whose) if asked.session == _SESSION else None
        if data is None:
            return Error.INVALID_SESSION
        if asked.opcode == Opcode.TERMINATE:
            del self._open[whose]
            return b""
        end = min(len(data), asked.offset + _ROOM * (_BURST if asked.opcode == Opcode.BURST else 1))
        parts = [data[at : min(at + _ROOM, end)] for at in range(asked.offset, end, _ROOM)]
        return parts or Error.END
