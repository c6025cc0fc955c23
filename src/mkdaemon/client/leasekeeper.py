"""The lease of a program that flies now and then: taken with the first setpoint, given back when nothing is flown."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from typing import Any, Final

from mkdaemon.client.lease import Lease
from mkdaemon.errors import CommandRejectedError, MkError

BUSY: Final = "busy"
"""Token of the refusal while the release of the lease before is under way."""
BUSY_TRIES: Final = 20
"""How often a lease is asked for that is refused as busy; a release takes up to 1.5 s."""
BUSY_PAUSE: Final = 0.1
"""Between two of these [s]."""
LOOKING: Final = 0.01
"""Between two looks whether a lease that was asked for is held [s]."""


class LeaseKeeper:
    """Holds the lease while somebody flies.

    Args:
        take: takes the lease for as long as its context lasts.
    """

    def __init__(self, take: Callable[[], AbstractAsyncContextManager[Lease]]) -> None:
        self._take = take
        self._task: asyncio.Task[None] | None = None
        self._end = asyncio.Event()
        self.lease: Lease | None = None
        self._failure: str | None = None

    @property
    def is_engaged(self) -> bool:
        """Whether the daemon sends what is streamed."""
        return self.lease is not None and self.lease.is_engaged

    @property
    def words(self) -> str:
        """Where the lease stands, in words."""
        if self.lease is not None:
            return self.lease.reason
        return "the lease is asked for" if self._task is not None and not self._end.is_set() else ""

    def ask(self) -> None:
        """Ask for the lease where it is not held and not asked for yet.

        Raises:
            MkError: the lease was refused; says why.
        """
        if self._failure is not None:
            reason, self._failure = self._failure, None
            raise MkError(reason)
        if self._task is not None and self._task.done():
            ended, self._task = self._task, None
            ended.result()
        if self._task is None:
            self._end.clear()
            self._task = asyncio.create_task(self._hold(), name="lease on demand")

    def stream(self, kind: str, fields: Mapping[str, Any]) -> None:
        """Put a setpoint; the lease is asked for where it is not held, and until then nothing is put.

        Args:
            kind: last word of a key `setpoint/<kind>`.
            fields: of the setpoint.

        Raises:
            CommandRejectedError: `bad_field`: the setpoint is none.
            MkError: the lease was refused or has ended; says why.
        """
        self.ask()
        if self.lease is not None:
            self.lease.put(kind, fields)

    async def take(self) -> Lease:
        """Ask for the lease and wait until it is held.

        Raises:
            MkError: the lease was refused; says why.
        """
        while True:
            self.ask()
            if self.lease is not None:
                return self.lease
            await asyncio.sleep(LOOKING)

    def take_refusal(self) -> str | None:
        """The newest refusal of what was streamed, once; None where nothing was refused."""
        refusal = None if self.lease is None else self.lease.take_refusal()
        return None if refusal is None else str(refusal)

    def give_back(self) -> None:
        """Give the lease back; the aircraft is released. What is under way ends by itself."""
        self.lease = None
        self._failure = None
        self._end.set()

    async def close(self) -> None:
        """Give it back and wait for the end."""
        self.give_back()
        if self._task is not None:
            await asyncio.gather(self._task, return_exceptions=True)

    async def _hold(self) -> None:
        for _ in range(BUSY_TRIES):
            try:
                async with self._take() as lease:
                    if not self._end.is_set():
                        self.lease = lease
                    await self._end.wait()
            except CommandRejectedError as error:
                if error.token == BUSY and not self._end.is_set():
                    await asyncio.sleep(BUSY_PAUSE)
                    continue
                self._fail(str(error))
            except MkError as error:
                self._fail(str(error))
            return
        self._fail("the daemon is busy with a release: press again")

    def _fail(self, reason: str) -> None:
        self.lease = None
        if not self._end.is_set():
            self._failure = reason
