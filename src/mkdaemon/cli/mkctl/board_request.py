"""One request to a board, where silence is an answer that the command itself knows how to tell."""

from __future__ import annotations

from mkdaemon.client import Vehicle
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.refusals import TOKENS
from mkdaemon.telemetry.status import Status

_NO_ANSWER = frozenset({Status.TIMEOUT, Status.BUSY})


async def try_request(uav: Vehicle, board: Board, message: WireMessage) -> WireMessage | None:
    """Send one request through the daemon and return the answer as a message; None where none came in time.

    The user has asked for what the message does, so the daemon's question for confirmation is answered here.

    Raises:
        CommandRejectedError: the daemon refused it; says token, reason and fix.
        MkError: no daemon.
    """
    try:
        return await uav.request(board, message, confirm=message.spec.danger is not None)
    except CommandRejectedError as error:
        refusal = TOKENS.get(error.token)
        if refusal is not None and refusal.status in _NO_ANSWER:
            return None
        raise
