"""`mkctl release`: release the aircraft."""

from __future__ import annotations

import asyncio
import sys
from typing import TYPE_CHECKING, Final

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.program import EXIT_FAILURE
from mkdaemon.client.localsocket import ask_locally, find_socket
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.telemetry.refusals import Token

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import ReleaseReport

BUS_TIME: Final = 1.0
"""The bus has this long before the Unix socket is asked too [s]: a release asked for twice is one release."""


async def release(reason: str = "asked for by mkctl", *, connection: Connection = HERE) -> int:
    """Give the aircraft back to the pilot now, from any client: neutral sticks, then the pilot's sticks rule again.

    The lease ends. If the bus is too busy and the daemon runs on this machine, it is asked over its Unix socket.
    Exit code 0 when it was confirmed or cannot be, 1 otherwise.

    To stop only the manoeuvre, use `mkctl abort`: the aircraft holds, and the lease stays. Neither stops motors: the
    pilot's sticks do, or on a public fork of the FlightCtrl `mkctl board motors stop`.

    Example: mkctl release

    Args:
        reason: Published with the event.
    """
    done = await release_somehow(connection, reason)
    connection.show(dict(done), done.status.words)
    return 0 if done.is_done else EXIT_FAILURE


async def release_somehow(connection: Connection, reason: str) -> ReleaseReport:
    """Release over the bus; where that has not answered soon, or fails, over the Unix socket of a daemon here.

    Args:
        connection: which vehicle.
        reason: published with the event.

    Raises:
        CommandRejectedError: the daemon refused.
        MkError: no daemon answers.
    """
    over_bus = asyncio.create_task(_release_over_bus(connection, reason), name="release over the bus")
    path = find_socket(connection.vehicle, connection.connect)
    if path is None:
        return await over_bus
    await asyncio.wait({over_bus}, timeout=BUS_TIME)
    if over_bus.done() and (over_bus.exception() is None or _is_refusal(over_bus.exception())):
        return await over_bus
    try:
        answer = await ask_locally(path, "release", reason)
    except MkError as error:
        print(f"mkctl: {error}", file=sys.stderr)
        return await over_bus
    from mkdaemon.telemetry.control import ReleaseReport

    over_bus.cancel()
    return answer.as_a(ReleaseReport)


def _is_refusal(error: BaseException | None) -> bool:
    """Whether the daemon has answered the request itself: a bus that is busy has not brought it."""
    return isinstance(error, CommandRejectedError) and error.token != Token.BUSY


async def _release_over_bus(connection: Connection, reason: str) -> ReleaseReport:
    async with connection.open() as client:
        return await client.release(reason)
