"""Reads the active parameter set before a flight: the pilot's gate, what the checks need, and the aircraft's model."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path
from typing import Final

from mkdaemon.control.activeset import UNREAD, Gate, GateKind, KnownSet
from mkdaemon.errors import CommandRejectedError, LinkError
from mkdaemon.link.link import Link
from mkdaemon.protocol.messages import ACTIVE_SET, Settings, SettingsRequest
from mkdaemon.protocol.settings import ParameterSet, poti_number
from mkdaemon.protocol.wire import Board

_FIRST_POTI: Final = 4
"""Place of poti 1 in the list of channels, after pitch, roll, throttle and yaw."""
VOLTS_OF_PACK: Final = 50
"""From this value on UnterspannungsWarnung is that of the whole battery [0.1 V]; below, of a cell."""
READ_TIMEOUT: Final = 1.0
"""Longest time the question may take [s]; a FlightCtrl answers within 40 ms."""


async def read_active_set(link: Link) -> ParameterSet | None:
    """Read the active parameter set; None where it cannot be read or its revision is unknown.

    A FlightCtrl behind a NaviCtrl cannot be asked without cutting telemetry off.
    """
    if link.direct_board is not Board.FC:
        return None
    try:
        async with asyncio.timeout(READ_TIMEOUT):
            reply = await link.request(SettingsRequest(index=ACTIVE_SET), board=Board.FC, timeout=0.3, retries=1)
    except (CommandRejectedError, LinkError, TimeoutError):
        return None
    assert isinstance(reply, Settings)
    parameters = ParameterSet.from_payload(reply.parameters)
    return None if parameters.layout is None else parameters


def free_disk(folder: Path | None) -> float | None:
    """Free space where a folder is, or will be made [bytes]; None without a folder, or if unknown."""
    while folder is not None:
        try:
            return float(shutil.disk_usage(folder).free)
        except FileNotFoundError:
            folder = folder.parent if folder != folder.parent else None
        except OSError:
            return None
    return None


def active_set(parameters: ParameterSet | None) -> KnownSet:
    """Return what the active set says about a flight; an unknown one leaves it to the pilot's own check."""
    if parameters is None:
        return UNREAD
    layout = parameters.layout
    assert layout is not None
    has_share = "global_config_3" in layout.places and "vario_failsafe" in parameters.flags("global_config_3")
    low = _number(parameters, "low_voltage_warning")
    return KnownSet(
        gate_of(parameters),
        parameters.name or "(unnamed)",
        has_height_control="altitude_control" in parameters.flags("global_config"),
        emergency_throttle=None if has_share else _number(parameters, "emergency_throttle"),
        emergency_time=_number(parameters, "emergency_throttle_time"),
        low_cell=0.1 * low if low < VOLTS_OF_PACK else None,
    )


def gate_of(parameters: ParameterSet) -> Gate:
    """Return the pilot's gate, the parameter ExternalControl."""
    value = _number(parameters, "external_control")
    poti = poti_number(value)
    if poti is None:
        return Gate(GateKind.CONSTANT, value)
    return Gate(GateKind.CHANNEL, value, _shared_channel(parameters, poti))


def _number(parameters: ParameterSet, name: str) -> int:
    value = parameters[name]
    assert isinstance(value, int)
    return value


def _shared_channel(parameters: ParameterSet, poti: int) -> int | None:
    """Receiver channel on which this poti is the switch of height control too; None where it is not."""
    assert parameters.layout is not None
    channels, number = parameters["channels"], _FIRST_POTI + poti - 1
    assert isinstance(channels, tuple)
    has_switch = "altitude_channel" in parameters.layout.places
    if not has_switch or "altitude_control" not in parameters.flags("global_config") or number >= len(channels):
        return None
    channel = channels[number]
    return channel if parameters["altitude_channel"] == channel else None
