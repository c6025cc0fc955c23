"""A daemon that runs its table of procedures on boards at the level of messages, without a bus, a line or time."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Any

import msgpack

from mkdaemon.bus.codec import encode_map
from mkdaemon.client import Answer, Vehicle
from mkdaemon.daemon.procedures.table import PROCEDURES, request_model
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.status import Status
from tests.protocol.procedures.talk import Reply, drive


class BoardVehicle(Vehicle):
    """A vehicle whose boards answer in this process.

    Attributes:
        asked: every verb with its fields.
    """

    def __init__(self, board: Callable[[WireMessage], Reply]) -> None:
        super().__init__(None, "boards", "none")
        self.board = board
        self.asked: list[tuple[str, dict[str, Any]]] = []
        self.steps: list[Any] = []

    async def command(
        self, target: str, name: str, fields: Mapping[str, Any] | None = None, *, patience: float = 0.0
    ) -> Answer:
        given = msgpack.unpackb(encode_map(dict(fields or {})))
        self.asked.append((name, given))
        request = request_model(name).model_validate(given)
        if not request.is_confirmed:
            raise CommandRejectedError("not_confirmed", f"{name} is dangerous.", "Confirm it.")
        try:
            reply = drive(PROCEDURES[name].make(request), self.board, self.steps)
        except CommandRejectedError:
            raise
        except MkError as error:
            raise CommandRejectedError("procedure_failed", f"{name} failed: {error}.", "Repeat it.") from error
        return Answer(Status.ACCEPTED, msgpack.unpackb(encode_map(dict(reply))))

    @asynccontextmanager
    async def watch(self, *patterns: str, **_: Any) -> AsyncIterator[AsyncIterator[Any]]:
        async def none() -> AsyncIterator[Any]:
            for _ in ():
                yield

        yield none()
