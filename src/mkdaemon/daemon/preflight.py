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
    return Gate(GateKind.CONSTANT if poti_number(value) is None else GateKind.CHANNEL, value)
