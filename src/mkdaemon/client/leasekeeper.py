"""The lease of a program that flies now and then: taken when a flight begins, given back when it ends."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from typing import Any, Final

from mkdaemon.client.lease import Lease
from mkdaemon.client.session import FlightSession, SessionState
from mkdaemon.errors import MkError

LOOKING: Final = 0.01
"""Between two looks whether a lease that was asked for is held [s]."""


class LeaseKeeper:
    """Carries out what a flight session decides: takes the lease, puts setpoints, gives the lease back.

    Attributes:
        flight: the session, which decides.
    """

    def __init__(self, take: Callable[[FlightSession], AbstractAsyncContextManager[Lease]]) -> None:
        """Hold nothing yet.

        Args:
            take: takes the lease of a session for as long as its context lasts.
        """
        self.flight = FlightSession()
        self._take = take
        self._lease: Lease | None = None
        self._task: asyncio.Task[None] | None = None
        self._end = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    @property
    def is_engaged(self) -> bool:
        """Whether the daemon sends what is streamed."""
        return self.flight.is_engaged

    def begin(self) -> None:
        """Begin a flight by a decision of the pilot or program that flies: ask for the lease unless it is held."""
        if self.flight.state is SessionState.LOST:
            self._end.set()
        self.flight.resume()
        self.flight.take()
        self._end.clear()
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._hold(), name="lease on demand")

    def stream(self, kind: str, fields: Mapping[str, Any]) -> None:
        """Put a setpoint of a stream; until the lease is held nothing is put.

        Args:
            kind: last word of a key `setpoint/<kind>`.
            fields: of the setpoint.

        Raises:
            CommandRejectedError: `bad_field`: the setpoint is none.
            MkError: the lease was refused or has ended; says why.
        """
        setpoint = self.flight.stream(kind, fields, self._loop.time())
        if self._lease is not None:
            self._lease.send(setpoint)

    def step(self) -> None:
        """Put the next setpoint of what the session repeats.

        Raises:
            MkError: the lease was refused or has ended; says why.
        """
        setpoint = self.flight.step(self._loop.time())
        if self._lease is not None:
            self._lease.send(setpoint)

    async def take(self) -> Lease:
        """Begin a flight and wait until the lease is held.

        Raises:
            MkError: the lease was refused; says why.
        """
        self.begin()
        while self._lease is None or self.flight.state is not SessionState.HELD:
            self.flight.take()
            await asyncio.sleep(LOOKING)
        return self._lease

    def give_back(self) -> None:
        """End the flight; the aircraft is released. What is under way ends by itself."""
        self.flight.end()
        self._end.set()

    async def close(self) -> None:
        """Give it back and wait for the end."""
        self.give_back()
        if self._task is not None:
            await asyncio.gather(self._task, return_exceptions=True)

    async def _hold(self) -> None:
        """Hold the lease for as long as one is wanted; a flight may begin while the lease before it ends."""
        while self.flight.is_wanted:
            try:
                async with self._take(self.flight) as self._lease:
                    await self._end.wait()
            except MkError as error:
                self.flight.refused(error)
            finally:
                self._lease = None
