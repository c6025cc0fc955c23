"""How a verb is asked for: a request, its typed answer, and the progress of what takes many requests."""

from __future__ import annotations

import os
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, TypeVar

from mkdaemon.client.answers import Answer
from mkdaemon.client.samples import Sample
from mkdaemon.client.taskerrors import background
from mkdaemon.client.transport import Transport
from mkdaemon.files import user_name

if TYPE_CHECKING:
    from pydantic import BaseModel

    from mkdaemon.telemetry.procedure import ProcedureProgress

PROCEDURE_TIME: Final = 600.0
"""Longest wait for the end of a procedure [s]; that of `telemetry.verbs`, which takes too long to be imported here."""
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

    async def ask(self, verb: str, reply: str, fields: Mapping[str, Any], patience: float) -> _Reply:
        """Ask for a verb, `do/<verb>`, and return its answer.

        Args:
            verb: its name.
            reply: what the daemon answers, `module:Class` of `mkdaemon.telemetry`.
            fields: of its request; what is None is left out.
            patience: longest wait [s].

        Raises:
            CommandRejectedError: it was refused, or failed; says token, reason and fix.
            ProtocolError: the answer is none that this version knows.
            MkError: no daemon serves this vehicle.
        """
        return _as(reply, await self._ask(verb, fields, patience))

    async def run(self, verb: str, reply: str, fields: Mapping[str, Any], on_progress: OnProgress | None) -> _Reply:
        """Ask for a procedure, and return its answer at its end; see `ask`.

        Leaving early (cancellation) ends the waiting, not the procedure; see `Vehicle.cancel`.

        Args:
            verb: its name.
            reply: what the daemon answers.
            fields: of its request; what is None is left out.
            on_progress: called with every step.
        """
        if on_progress is None:
            return _as(reply, await self._ask(verb, fields, PROCEDURE_TIME, with_holder=True))
        async with self._transport.watch(PROGRESS) as samples, background(_follow(samples, verb, on_progress)):
            return _as(reply, await self._ask(verb, fields, PROCEDURE_TIME, with_holder=True))

    async def order(self, verb: str, fields: Mapping[str, Any], patience: float, *, with_holder: bool = False) -> None:
        """Ask for a verb that is answered with nothing; see `ask`.

        Args:
            verb: its name.
            fields: of its request.
            patience: longest wait [s].
            with_holder: the request names its client.
        """
        (await self._ask(verb, fields, patience, with_holder=with_holder)).require()

    async def _ask(self, verb: str, fields: Mapping[str, Any], patience: float, *, with_holder: bool = False) -> Answer:
        asked = {"holder": client_name()} if with_holder else {}
        asked |= {name: value for name, value in fields.items() if value is not None}
        return await self._transport.command("do", verb, asked, patience=patience)


def _as(reply: str, answer: Answer) -> _Reply:  # type: ignore[type-var]  # who calls says which
    """An answer as a value of a class, whose module is imported when it is needed."""
    module, _, name = reply.partition(":")
    found: _Reply = answer.as_a(getattr(import_module(f"mkdaemon.telemetry.{module}"), name))
    return found


async def _follow(samples: AsyncIterator[Sample], verb: str, on_progress: OnProgress) -> None:
    from mkdaemon.telemetry.procedure import ProcedureProgress

    async for sample in samples:
        progress = ProcedureProgress.model_validate(sample.fields)
        if (progress.verb, progress.holder) == (verb, client_name()):
            on_progress(progress)
