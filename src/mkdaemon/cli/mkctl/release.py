"""`mkctl release`: let go of the aircraft."""

from __future__ import annotations

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE
from mkdaemon.client import ReleaseOutcome

_WORDS = {
    ReleaseOutcome.CONFIRMED: "released, and the FlightCtrl confirmed it",
    ReleaseOutcome.NOT_OBSERVABLE: "released; no confirmation comes through the NaviCtrl between us and the FlightCtrl",
    ReleaseOutcome.UNCONFIRMED: "released, NOT confirmed: the line is silent until the FlightCtrl lets go itself (6 s)",
    ReleaseOutcome.NOT_SENT: "NOT sent, the line is down; it is the first thing sent when the line is back",
}


async def release(reason: str = "asked for by mkctl", *, connection: Connection = HERE) -> int:
    """Let go of the aircraft, now, whoever flies: neutral sticks, then the pilot's sticks rule again.

    This does not stop motors. Exit code 0 when it was confirmed or cannot be, 1 otherwise.

    Args:
        reason: Published with the event.
    """
    async with connection.open() as client:
        done = await client.release(reason)
    print(json_line(done.fields) if connection.json else _WORDS[done.outcome])
    return 0 if done.outcome.is_done else EXIT_FAILURE
