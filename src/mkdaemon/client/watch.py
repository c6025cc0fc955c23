"""A subscription as an asynchronous iterator."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from typing import Final

import zenoh

from mkdaemon.bus.callbacks import direct
from mkdaemon.client.samples import Sample

BACKLOG: Final = 4096
"""Samples a watcher may lag behind before the oldest are dropped."""


class Handover:
    """Hands samples from Zenoh's threads to the loop, and wakes it once for all that come together.

    What a frame of the boards makes comes as a burst of several keys; a wake-up of the loop costs more than a sample.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: deque[tuple[Callable[[zenoh.Sample], None], zenoh.Sample]] = deque()
        self._is_called = False

    def arrived(self, take: Callable[[zenoh.Sample], None], sample: zenoh.Sample) -> None:
        """Have `take` called on the loop with a sample; from any thread, in order."""
        self._waiting.append((take, sample))
        # Two threads that both find it false call twice, and the second call finds nothing.
        if not self._is_called:
            self._is_called = True
            with suppress(RuntimeError):  # the loop may be closing
                self._loop.call_soon_threadsafe(self._drain)

    def _drain(self) -> None:
        self._is_called = False  # first: what comes from now on calls again
        for _ in range(len(self._waiting)):
            take, sample = self._waiting.popleft()
            take(sample)


class Watch:
    """Samples of some keys, as they come.

    `async for sample in watch` subscribes when the loop begins. `async with watch as samples` subscribes at once, so
    that nothing is missed of what a command sets off, and ends the subscription on leaving. The oldest samples are
    dropped when the reader is that many behind (4096 unless given).

    Attributes:
        dropped: what arrived and is not a value of a key of this vehicle: put to a wildcard, or a deletion.
    """

    def __init__(
        self,
        session: zenoh.Session,
        expressions: Sequence[zenoh.KeyExpr],
        read: Callable[[zenoh.Sample], Sample | None],
        handover: Handover,
        backlog: int | None = None,
    ) -> None:
        self._session = session
        self._handover = handover
        self._expressions = expressions
        self._read = read
        self.dropped = 0
        self._queue: asyncio.Queue[zenoh.Sample] = asyncio.Queue(BACKLOG if backlog is None else backlog)
        self._subscribers: list[zenoh.Subscriber[None]] = []

    async def __aenter__(self) -> AsyncIterator[Sample]:
        queue, handover = self._queue, self._handover

        def put(sample: zenoh.Sample) -> None:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(sample)

        def on_sample(sample: zenoh.Sample) -> None:
            handover.arrived(put, sample)

        handler = direct(on_sample, self._drop)
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
            sample = self._read(await self._queue.get())
            if sample is None:
                self._drop()
            else:
                yield sample

    def _drop(self) -> None:
        self.dropped += 1
