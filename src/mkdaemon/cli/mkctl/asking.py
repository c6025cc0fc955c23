"""One request to a board, where silence is an answer that the command itself knows how to tell."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any, Final, Protocol

from mkdaemon.client import Answer
from mkdaemon.client.samples import message_from
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.refusals import Status

_NO_ANSWER: Final = frozenset({Status.TIMEOUT, Status.BUSY})
_BUSY_WAIT: Final = 0.2
"""Before asking again what the daemon was too busy for [s]."""


class Commander(Protocol):
    """What is needed of a client."""

    async def command(self, target: str, name: str, fields: Mapping[str, Any] | None = None) -> Answer:
        """Ask a board something."""


async def ask_board(client: Commander, board: Board, message: WireMessage) -> WireMessage | None:
    """Send one request through the daemon and return the answer as a message; None where none came in time.

    The user has asked for what the message does, so the daemon's question for confirmation is answered here.

    Raises:
        CommandRejectedError: the daemon refused it; says token, reason and fix.
        MkError: no daemon.
    """
    fields = message.model_dump()
    if message.spec.danger is not None:
        fields["confirm"] = True
    answer = await client.command(board.word, message.spec.key, fields)
    if answer.status == Status.BUSY:
        await asyncio.sleep(_BUSY_WAIT)
    if answer.status in _NO_ANSWER:
        return None
    return message_from(answer.reply_type, answer.require())
