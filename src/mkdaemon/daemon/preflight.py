"""Before somebody flies by sticks: does the FlightCtrl listen to them, and can the pilot take over by a switch?

The parameter ExternalControl of the active set is the gate: up to 128 it is shut, 248 to 255 are a channel of the
transmitter, and a constant above 128 holds it open for good. Source: docs/safety.md; docs/firmware-notes, section 6.
"""

from __future__ import annotations

import asyncio
from typing import Final

from mkdaemon.errors import CommandRejectedError, LinkError
from mkdaemon.link.link import Link
from mkdaemon.protocol.messages import ACTIVE_SET, Settings, SettingsRequest
from mkdaemon.protocol.settings import ParameterSet, poti_number
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.refusals import Token, refuse

OPEN_ABOVE: Final = 128
"""The gate is open while its value is above this."""
LONGEST: Final = 1.0
"""Longest time the question may take [s]; a FlightCtrl answers within 40 ms."""


async def check_gate(link: Link, *, allow_constant: bool) -> None:
    """Refuse a gate that is shut for good, and one the pilot cannot shut.

    A FlightCtrl behind a NaviCtrl cannot be asked without cutting telemetry off; that, silence and an unknown revision
    of the parameters leave the answer to the pilot's own check.

    Args:
        link: the line.
        allow_constant: the operator accepts a constant.

    Raises:
        CommandRejectedError: `gate_shut`, `gate_constant`.
    """
    value = await _read_gate(link)
    if value is None or poti_number(value) is not None:
        return
    if value <= OPEN_ABOVE:
        raise refuse(Token.GATE_SHUT, value=value)
    if not allow_constant:
        raise refuse(Token.GATE_CONSTANT, value=value)


async def _read_gate(link: Link) -> int | None:
    """ExternalControl of the active set; None where it cannot be known."""
    if link.direct_board is not Board.FC:
        return None
    try:
        async with asyncio.timeout(LONGEST):
            reply = await link.request(SettingsRequest(index=ACTIVE_SET), board=Board.FC, timeout=0.3, retries=1)
    except (CommandRejectedError, LinkError, TimeoutError):
        return None
    assert isinstance(reply, Settings)
    parameters = ParameterSet.from_payload(reply.parameters)
    if parameters.layout is None:
        return None
    value = parameters["external_control"]
    assert isinstance(value, int)
    return value
