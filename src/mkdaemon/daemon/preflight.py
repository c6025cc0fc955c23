"""Reads the active parameter set before a flight: the pilot's gate, and what makes the model of the aircraft."""

from __future__ import annotations

import asyncio
from typing import Final

from mkdaemon.control.preflight import Gate, GateKind
from mkdaemon.errors import CommandRejectedError, LinkError
from mkdaemon.link.link import Link
from mkdaemon.protocol.messages import ACTIVE_SET, Settings, SettingsRequest
from mkdaemon.protocol.settings import ParameterSet, poti_number
from mkdaemon.protocol.wire import Board

_FIRST_POTI: Final = 4
"""Place of poti 1 in the list of channels, after pitch, roll, throttle and yaw."""
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


def gate_of(parameters: ParameterSet | None) -> Gate:
    """Return the pilot's gate, the parameter ExternalControl; an unknown set leaves it to the pilot's own check."""
    if parameters is None:
        return Gate(GateKind.UNKNOWN)
    value = parameters["external_control"]
    assert isinstance(value, int)
    poti = poti_number(value)
    if poti is None:
        return Gate(GateKind.CONSTANT, value)
    return Gate(GateKind.CHANNEL, value, _shared_channel(parameters, poti))


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
