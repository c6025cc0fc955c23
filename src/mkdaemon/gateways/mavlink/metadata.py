"""Component metadata: what each parameter means, for the help of a ground station.

Sources: https://mavlink.io/en/services/component_information.html; `component_metadata/*.schema.json` of
github.com/mavlink/mavlink. pymavlink 2.4.50 has no COMPONENT_METADATA, so it is packed here.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, Final

from mkdaemon.gateways.mavlink.dialect import mavlink
from mkdaemon.gateways.mavlink.files import checksum
from mkdaemon.gateways.mavlink.parameterids import ids_of
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
