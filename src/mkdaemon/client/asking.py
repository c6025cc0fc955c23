"""How a verb is asked for: a request, its typed answer, and the progress of what takes many requests."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from typing import TYPE_CHECKING, Any, Final, TypeVar

from mkdaemon.client.answers import Answer
from mkdaemon.client.samples import Sample
from mkdaemon.client.transport import Transport
from mkdaemon.files import user_name

if TYPE_CHECKING:
    from pydantic import BaseModel

    from mkdaemon.telemetry.procedure import ProcedureProgress

PROGRESS: Final = "event/progress"
"""Key of the progress of every procedure."""

OnProgress = Callable[["ProcedureProgress"], None]
"""Hears of every step of the procedure that was asked for."""
_Reply = TypeVar("_Reply", bound="BaseModel")


def client_name() -> str:
    """A name for this program that no other has: user, machine, process."""
    raw = f"{user_name()}-{socket.gethostname()}-{os.getpid()}"
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in raw)[:64]


class Asking:
    """Asks the daemon for verbs. Base of every service."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    async def ask(
        self,
        reply: type[_Reply],
        verb: str,
        fields: Mapping[str, Any],
        patience: float,
        *,
        on_progress: OnProgress | None = None,
        with_holder: bool = False,
    ) -> _Reply:
        """Ask for a verb, `do/<verb>`, and return its answer.

        Leaving early (cancellation) ends the waiting, not a procedure; see `Vehicle.cancel`.

        Args:
            reply: what the daemon answers.
            verb: its name.
            fields: of its request; what is None is left out.
            patience: longest wait [s].
            on_progress: called with every step of a procedure.
            with_holder: the request names its client.

        Raises:
            CommandRejectedError: it was refused, or failed; says token, reason and fix.
            ProtocolError: the answer is none that this version knows.
            MkError: no daemon speaks for this vehicle.
        """
        return (await self._ask(verb, fields, patience, on_progress, with_holder=with_holder)).as_a(reply)

    async def order(self, verb: str, fields: Mapping[str, Any], patience: float, *, with_holder: bool = False) -> None:
        """Ask for a verb that is answered with nothing; see `ask`.

        Args:
            verb: its name.
            fields: of its request.
            patience: longest wait [s].
            with_holder: the request names its client.

        Raises:
            CommandRejectedError: it was refused, or failed.
            MkError: no daemon speaks for this vehicle.
        """
        (await self._ask(verb, fields, patience, None, with_holder=with_holder)).require()

    async def _ask(
        self,
        verb: str,
        fields: Mapping[str, Any],
        patience: float,
        on_progress: OnProgress | None,
        *,
        with_holder: bool,
    ) -> Answer:
        asked = {"holder": client_name()} if with_holder else {}
        asked |= {name: value for name, value in fields.items() if value is not None}
        if on_progress is None:
            return await self._transport.command("do", verb, asked, patience=patience)
        async with self._transport.watch(PROGRESS) as samples:
            following = asyncio.create_task(_follow(samples, verb, on_progress), name=f"progress of {verb}")
            try:
                answer = await self._transport.command("do", verb, asked, patience=patience)
            finally:
                following.cancel()
                await asyncio.gather(following, return_exceptions=True)
        return answer


async def _follow(samples: AsyncIterator[Sample], verb: str, on_progress: OnProgress) -> None:
    from mkdaemon.telemetry.procedure import ProcedureProgress

    async for sample in samples:
        progress = ProcedureProgress.model_validate(sample.fields)
        if (progress.verb, progress.holder) == (verb, client_name()):
            on_progress(progress)
