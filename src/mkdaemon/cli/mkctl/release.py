"""`mkctl release`: let go of the aircraft."""

from __future__ import annotations

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE

_WORDS = {
    "confirmed": "released, and the FlightCtrl confirmed it",
    "not_observable": "released; a confirmation cannot come this way (NaviCtrl between us and the FlightCtrl)",
    "unconfirmed": "released, but NOT confirmed: the line is silenced until the FlightCtrl lets go by itself (6 s)",
    "not_sent": "NOT sent, the line is down; it is the first thing sent when the line is back",
}


async def release(reason: str = "asked for by mkctl", *, connection: Connection = HERE) -> int:
    """Let go of the aircraft, now, whoever flies: neutral sticks, then the pilot's sticks rule again.

    This does not stop motors. Exit code 0 when it was confirmed or cannot be, 1 otherwise.

    Args:
        reason: Published with the event.
    """
    async with connection.open() as client:
        reply = (await client.command("do", "release", {"reason": reason})).require()
    print(json_line(reply) if connection.json else _WORDS.get(reply["status"], reply["status"]))
    return 0 if reply["status"] in {"confirmed", "not_observable"} else EXIT_FAILURE
