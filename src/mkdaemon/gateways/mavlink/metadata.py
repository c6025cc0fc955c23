"""Component metadata, what each parameter means for the help of a ground station, and the transfer of its files.

Only the few small files that the gateway itself makes can be read, and nothing can be written. Sources:
https://mavlink.io/en/services/component_information.html and ftp.html; `component_metadata/*.schema.json` of
github.com/mavlink/mavlink. pymavlink 2.4.50 has no COMPONENT_METADATA, so it is packed here.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections import OrderedDict
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final, NamedTuple

from mkdaemon.gateways.mavlink.dialect import Message, mavlink
from mkdaemon.gateways.mavlink.parameterids import ids_of
from mkdaemon.gateways.mavlink.stations import By
from mkdaemon.protocol.settings import Layout, layout_of
from mkdaemon.protocol.settings_fields import ParameterKind

COMPONENT_METADATA: Final = 397
"""Number of the message."""
_CRC_EXTRA: Final = 182
"""Of its fields: uint32_t time_boot_ms, uint32_t file_crc, char[100] uri."""
_FIELDS: Final = struct.Struct("<II100s")
GENERAL: Final = "general.json"
PARAMETERS: Final = "parameter.json"
_PARAMETER_TYPE: Final = 1
"""`COMP_METADATA_TYPE_PARAMETER`."""


class ComponentMetadata:
    """COMPONENT_METADATA: where the general file is."""

    def __init__(self, boot_ms: int, general: bytes) -> None:
        """Name it.

        Args:
            boot_ms: since the boot [ms].
            general: the file.
        """
        self._payload = _FIELDS.pack(boot_ms, checksum(general), f"mftp://{GENERAL}".encode())

    def pack(self, mav: Any) -> bytes:
        """The frame, numbered and signed as `mav` says."""
        message = mavlink.MAVLink_message(COMPONENT_METADATA, "COMPONENT_METADATA")
        return bytes(message._pack(mav, _CRC_EXTRA, self._payload))  # noqa: SLF001  # as the messages of the dialect do


def documents(revision: int) -> Mapping[str, bytes]:
    """The files, by name.

    Args:
        revision: of the settings, whose layout is known.
    """
    parameters = _packed({"version": 1, "parameters": _parameters(revision)})
    general = {
        "version": 1,
        "vendorName": "MikroKopter",
        "metadataTypes": [
            {"type": _PARAMETER_TYPE, "uri": f"mftp://{PARAMETERS}", "fileCrc": checksum(parameters)},
        ],
    }
    return {GENERAL: _packed(general), PARAMETERS: parameters}


def _packed(document: object) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode()


def _parameters(revision: int) -> list[dict[str, Any]]:
    layout = layout_of(revision)
    return [] if layout is None else [_parameter(layout, row.id, row.name, row.place) for row in ids_of(revision)]


def _parameter(layout: Layout, name: str, setting: str, place: int | None) -> dict[str, Any]:
    parameter = layout.place(setting).parameter
    words = [parameter.meaning[:1].upper() + parameter.meaning[1:] + ("" if place is None else f" ({place + 1})")]
    words += [f"Unit: {parameter.unit}."] if parameter.unit else []
    words += (
        ["248 to 255 stand for potentiometer 8 to 1 of the transmitter."]
        if parameter.kind is ParameterKind.POTI
        else []
    )
    found: dict[str, Any] = {
        "name": name,
        "type": "Float",  # the values cross as REAL32, whole numbers of 0 to 255
        "decimalPlaces": 0,
        "increment": 1,
        "min": 0,
        "max": 255,
        "group": "FlightCtrl",
        "shortDesc": words[0],
        "longDesc": " ".join([f"{parameter.mk} in the firmware.", *words[1:]]),
    }
    bits = layout.bits(setting) if parameter.kind is ParameterKind.BITS else ()
    if bits:
        found["bitmask"] = [
            {"index": bit.mask.bit_length() - 1, "description": bit.name.replace("_", " ")} for bit in bits
        ]
    return found


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
    OPEN = 4
    READ = 5
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
        self._open: OrderedDict[By, bytes] = OrderedDict()

    def take(self, by: By, message: Message) -> None:
        """Answer a request."""
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, offset = _HEAD.unpack_from(payload)
        if opcode >= Opcode.ACK:
            return
        asked = Request(sequence, session, opcode, offset, payload[_HEAD.size :][:size])
        found = self._answer(by, asked)
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
            padded = list((head + data).ljust(251, b"\0"))
            by.send(mavlink.MAVLink_file_transfer_protocol_message(0, *by.program, padded))

    def _answer(self, whose: By, asked: Request) -> bytes | Error | list[bytes]:
        """Data of the answers, or why there is none."""
        match asked.opcode:
            case Opcode.NONE:
                return b""
            case Opcode.RESET:
                self._open.pop(whose, None)
                return b""
            case Opcode.OPEN:
                name = asked.data.rstrip(b"\0").decode("ascii", "replace").rpartition("/")[2]
                found = self.files.get(name)
                if found is None:
                    return Error.NOT_FOUND
                self._open[whose] = found
                while len(self._open) > _MOST_OPEN:
                    self._open.popitem(last=False)
                return len(found).to_bytes(4, "little")
            case Opcode.TERMINATE | Opcode.READ | Opcode.BURST:
                return self._from_session(whose, asked)
        return Error.UNKNOWN_COMMAND

    def _from_session(self, whose: By, asked: Request) -> bytes | Error | list[bytes]:
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
