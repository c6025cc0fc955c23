"""What is known of the motors before something is sent that must not meet running ones."""

from __future__ import annotations

from typing import Final

from mkdaemon.client import Vehicle
from mkdaemon.telemetry.refusals import Token, refuse

FRESH: Final = 3.0
"""Oldest flight state that counts [s]; the NaviCtrl tells it several times a second."""


async def motors_running(client: Vehicle) -> bool | None:
    """Whether motors run, by the last flight state; None where nobody has told lately."""
    flight = await client.state.flight.latest()
    return None if flight is None or flight.age >= FRESH else flight.value.motors_running


async def refuse_running(client: Vehicle, why: str) -> None:
    """Go on unless motors are known to run; what is unknown is left to the daemon's own gate.

    Args:
        client: the daemon's client.
        why: what running motors would mean, in words.

    Raises:
        CommandRejectedError: `motors_running`.
    """
    if await motors_running(client):
        raise refuse(Token.MOTORS_RUNNING, detail=why)
