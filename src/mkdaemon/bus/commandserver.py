"""Commands over the bus: each in a separate task, bounded, and answered off the loop.

What ends a flight has a separate way (`floods.URGENT`): neither commands that are being worked on nor answers that
wait or are not read make it `busy`. Beside 4,000 queries a second for `do/lease` every `do/release` was obeyed, but
3 of 5 clients were refused for too many queries.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from functools import partial
from itertools import count
from typing import Final

import structlog
import zenoh

from mkdaemon.bus.answers import AnswerThread
from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.codec import Payload, encode, encoding_of
from mkdaemon.bus.floods import URGENT, QueryBudgets, ShedCounter
from mkdaemon.bus.intake import read_payload, read_source
from mkdaemon.bus.keys import find
from mkdaemon.bus.names import key, received_suffix
from mkdaemon.bus.recording import BusRecorder
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.refusals import Token, refuse

_log = structlog.get_logger(__name__)
_ENCODING: Final = encoding_of(CommandResult)

Handler = Callable[[str, Payload], Awaitable[CommandResult]]
"""Answers a command: suffix and payload to a result; may raise `CommandRejectedError`."""


class CommandServer:
    """Answers commands of one vehicle; everything but Zenoh's callbacks runs on the loop it was made on."""

    def __init__(
        self,
        session: zenoh.Session,
        vehicle: str,
        recorder: BusRecorder,
        shed: ShedCounter,
        max_queries: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start the threads that reply.

        Args:
            session: open.
            vehicle: its name.
            recorder: hears of every command and its answer.
            shed: counts commands that were too many in a second.
            max_queries: commands worked on at a time, the urgent ones not counted.
            clock: what a second is, for commands that are too many in it [s].
        """
        self._session = session
        self._vehicle = vehicle
        self._recorder = recorder
        self._shed = shed
        self._max_queries = max_queries
        self._loop = asyncio.get_running_loop()
        self._exchanges = count(1)
        self._answering: set[asyncio.Task[None]] = set()
        self._is_leaving = False
        self._budgets = QueryBudgets(clock)
        limit = 4 * max_queries
        self._replies = AnswerThread("bus.replies", limit=limit, limit_per_key=limit)
        self._urgent_replies = AnswerThread("bus.urgent", limit=limit, limit_per_key=limit)

    def serve(self, root: str, handler: Handler) -> None:
        """Answer every command below a root (`cmd`, `do`) with `handler`; what is too much without the loop."""

        def on_query(query: zenoh.Query) -> None:
            asked = str(query.key_expr).partition(key(self._vehicle, ""))[2]
            if self._budgets.admit(asked, 0 if query.payload is None else len(query.payload)):
                self._loop.call_soon_threadsafe(self._take, query, handler, asked in URGENT)
                return
            # By a name that is ours: what strangers ask for may be long, and never the same twice.
            self._shed.add("unknown queries" if find(asked) is None else f"queries to {asked}")
            self._replies.shed(query)

        whole = key(self._vehicle, f"{root}/**")
        dropped = partial(self._shed.add, "queries that cannot be read")
        self._session.declare_queryable(whole, direct(on_query, dropped))

    async def stop(self) -> None:
        """End what is being worked on; what is asked from now on gets no answer."""
        self._is_leaving = True
        for task in self._answering:
            task.cancel()
        await asyncio.gather(*self._answering, return_exceptions=True)

    async def close(self) -> None:
        """Stop, and end the threads."""
        await self.stop()
        for thread in (self._replies, self._urgent_replies):
            await asyncio.to_thread(thread.close)

    def _take(self, query: zenoh.Query, handler: Handler, is_urgent: bool) -> None:
        """Begin to work on a command; on the loop."""
        replies = self._urgent_replies if is_urgent else self._replies
        if self._is_leaving:
            self._reply(replies, query, None)
        elif len(self._answering) >= self._max_queries and not is_urgent:
            error = refuse(Token.BUSY, detail=f"{len(self._answering)} commands are being worked on")
            self._reply(replies, query, refused(error))
        else:
            task = self._loop.create_task(self._answer(replies, query, handler), name=f"answer {query.key_expr}")
            self._answering.add(task)
            task.add_done_callback(self._answering.discard)

    async def _answer(self, replies: AnswerThread, query: zenoh.Query, handler: Handler) -> None:
        whole = str(query.key_expr)
        result: CommandResult | None = None
        exchange = 0
        try:
            suffix = received_suffix(self._vehicle, whole)
            if suffix is not None:  # a wildcard that looks around commands nothing
                exchange = next(self._exchanges)
                payload = read_payload(query.payload, suffix)
                source = read_source(query.source_info)
                self._recorder.query(suffix, payload if isinstance(payload, bytes) else b"", exchange, source)
                result = await _work_on(suffix, payload, handler)
        finally:
            self._reply(replies, query, result, exchange)

    def _reply(
        self, replies: AnswerThread, query: zenoh.Query, result: CommandResult | None, exchange: int = 0
    ) -> None:
        """Reply to a command, off the loop; None for no answer."""
        payload = None if result is None else encode(result)
        suffix = received_suffix(self._vehicle, str(query.key_expr))
        if payload is not None and exchange and suffix is not None:
            self._recorder.reply(suffix, payload, _ENCODING, exchange)

        def reply(query: zenoh.Query) -> None:
            if payload is not None:
                query.reply(query.key_expr, payload, encoding=_ENCODING)

        replies.submit(query, reply)


async def _work_on(suffix: str, payload: Payload, handler: Handler) -> CommandResult:
    started = time.monotonic()
    try:
        result = await handler(suffix, payload)
    except CommandRejectedError as error:
        result = refused(error)
    except Exception as error:  # noqa: BLE001
        # One client's strange request must not end the flight of another: answer, log, go on.
        _log.exception("command failed", key=suffix)
        result = refused(refuse(Token.INTERNAL, detail=f"{type(error).__name__}: {error}"))
    return result.model_copy(update={"duration": round(time.monotonic() - started, 6)})
