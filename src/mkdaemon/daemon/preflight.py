"""Reads the pilot's gate from the FlightCtrl: the parameter ExternalControl of the active set."""

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
_UNKNOWN: Final = Gate(GateKind.UNKNOWN)


async def read_gate(link: Link) -> Gate:
    """Read the gate; unknown where it cannot be read.

    A FlightCtrl behind a NaviCtrl cannot be asked without cutting telemetry off; that, silence and an unknown revision
    of the parameters leave the answer to the pilot's own check.
    """
    if link.direct_board is not Board.FC:
        return _UNKNOWN
    try:
        async with asyncio.timeout(READ_TIMEOUT):
            reply = await link.request(SettingsRequest(index=ACTIVE_SET), board=Board.FC, timeout=0.3, retries=1)
    except (CommandRejectedError, LinkError, TimeoutError):
        return _UNKNOWN
    assert isinstance(reply, Settings)
    parameters = ParameterSet.from_payload(reply.parameters)
    if parameters.layout is None:
        return _UNKNOWN
    value = parameters["external_control"]
    assert isinstance(value, int)
    return Gate(GateKind.CONSTANT if poti_number(value) is None else GateKind.CHANNEL, value)
