"""`mkctl release`: let go of the aircraft."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import ReleaseOutcome


async def release(reason: str = "asked for by mkctl", *, connection: Connection = HERE) -> int:
    """Let go of the aircraft, now, whoever flies: neutral sticks, then the pilot's sticks rule again.

    This does not stop motors. Exit code 0 when it was confirmed or cannot be, 1 otherwise.

    Args:
        reason: Published with the event.
    """
    async with connection.open() as client:
        done = await client.release(reason)
    print(json_line(done.fields) if connection.json else _words(done.outcome))
    return 0 if done.is_done else EXIT_FAILURE


def _words(outcome: ReleaseOutcome) -> str:
    from mkdaemon.telemetry.control import ReleaseOutcome

    match outcome:
        case ReleaseOutcome.CONFIRMED:
            return "released, and the FlightCtrl confirmed it"
        case ReleaseOutcome.NOT_OBSERVABLE:
            return "released; a confirmation cannot come this way (NaviCtrl between us and the FlightCtrl)"
        case ReleaseOutcome.UNCONFIRMED:
            return "released, but NOT confirmed: the line is silenced until the FlightCtrl lets go by itself (6 s)"
        case ReleaseOutcome.NOT_SENT:
            return "NOT sent, the line is down; it is the first thing sent when the line is back"
