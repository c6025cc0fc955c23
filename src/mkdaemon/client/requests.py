"""MikroKopter requests as typed messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar, overload

from mkdaemon.client.samples import message_from
from mkdaemon.client.transport import Transport
from mkdaemon.errors import ProtocolError

if TYPE_CHECKING:
    from mkdaemon.protocol import Board, WireMessage

_Reply = TypeVar("_Reply", bound="WireMessage")


class Requests(Transport):
    """Asks the boards."""

    @overload
    async def request(
        self, board: Board, message: WireMessage, expect: type[_Reply], *, confirm: bool = False
    ) -> _Reply: ...

    @overload
    async def request(self, board: Board, message: WireMessage, *, confirm: bool = False) -> WireMessage | None: ...

    async def request(
        self, board: Board, message: WireMessage, expect: type[_Reply] | None = None, *, confirm: bool = False
    ) -> WireMessage | None:
        """Send a MikroKopter request through the daemon and return the board's typed reply.

        Args:
            board: who is asked.
            message: the request, for example `SettingsRequest(index=255)`.
            expect: class the reply must have; a reply of another layout is an error.
            confirm: the danger that the message's declaration names is known and wanted.

        Returns:
            The reply; None where the board gives none to such a request.

        Raises:
            CommandRejectedError: it was refused, or the board did not answer in time; says token, reason and fix.
            ProtocolError: the reply is of another class than expected, or unknown here.
            MkError: no daemon speaks for this vehicle.
        """
        fields = message.model_dump()
        if confirm:
            fields["confirm"] = True
        answer = await self.command(board.word, message.spec.key, fields)
        reply = answer.require()
        found = message_from(answer.reply_type, reply) if answer.reply_type else None
        if expect is not None and not isinstance(found, expect):
            name = "nothing" if found is None else type(found).__name__
            msg = f"{board.word} answers {message.spec.key} with {name}, not {expect.__name__}"
            raise ProtocolError(msg)
        return found
