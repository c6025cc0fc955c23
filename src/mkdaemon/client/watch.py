"""A subscription as an asynchronous iterator."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from typing import Final

import zenoh

from mkdaemon.client.samples import Sample

BACKLOG: Final = 4096
"""Samples a watcher may lag behind before the oldest are dropped."""


class Watch:
    """Samples of some keys, as they come.

    `async for sample in watch` subscribes when the loop begins. `async with watch as samples` subscribes at once, so
    that nothing is missed of what a command sets off, and ends the subscription on leaving. The oldest samples are
    dropped when the reader is that many behind (4096 unless given).
    """

    def __init__(
        self,
        session: zenoh.Session,
        expressions: Sequence[zenoh.KeyExpr],
        read: Callable[[zenoh.Sample], Sample],
        backlog: int | None = None,
    ) -> None:
        self._session = session
        self._expressions = expressions
        self._read = read
        self._queue: asyncio.Queue[zenoh.Sample] = asyncio.Queue(BACKLOG if backlog is None else backlog)
        self._subscribers: list[zenoh.Subscriber[None]] = []

    async def __aenter__(self) -> AsyncIterator[Sample]:
        loop, queue = asyncio.get_running_loop(), self._queue

        def put(sample: zenoh.Sample) -> None:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(sample)

        def on_sample(sample: zenoh.Sample) -> None:
            with suppress(RuntimeError):  # the loop may be closing
                loop.call_soon_threadsafe(put, sample)

        handler = zenoh.handlers.Callback(on_sample, indirect=False)
        self._subscribers = [self._session.declare_subscriber(one, handler) for one in self._expressions]
        return self._samples()

    async def __aexit__(self, *_: object) -> None:
        subscribers, self._subscribers = self._subscribers, []
        for subscriber in subscribers:
            with suppress(zenoh.ZError):  # the session may be closed
                subscriber.undeclare()  # type: ignore[no-untyped-call]

    def __aiter__(self) -> AsyncIterator[Sample]:
        return self._subscribed()

    async def _subscribed(self) -> AsyncIterator[Sample]:
        async with self as samples:
            async for sample in samples:
                yield sample

    async def _samples(self) -> AsyncIterator[Sample]:
        while True:
            yield self._read(await self._queue.get())
