"""The client library on a cockpit: leases and setpoints as over the bus, in virtual time and without Zenoh."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any, Final, cast

from pydantic import BaseModel

from lab.rigs.cockpit import Cockpit
from mkdaemon.bus.codec import encoding_of
from mkdaemon.client.answers import Answer
from mkdaemon.client.lease import Lease
from mkdaemon.client.samples import Sample
from mkdaemon.client.session import FlightSession
from mkdaemon.client.transport import Transport
from mkdaemon.errors import MkError
from mkdaemon.telemetry.command import LeaseRequest
from mkdaemon.telemetry.control import HolderGrant, LeaseGrant
from mkdaemon.telemetry.setpoint import SETPOINTS
from mkdaemon.telemetry.status import Status

WAY: Final = (0.0005, 0.004)
"""Shortest and longest way of a sample on the bus [s]; Zenoh on loopback needs a millisecond."""


HEARD: Final = ("control/status", "event/command")
"""What a lease hears of."""


class _Stream:
    """A publisher of setpoints."""

    def __init__(self, client: CockpitClient, suffix: str) -> None:
        self._client, self._kind = client, next(kind for kind in SETPOINTS if kind.suffix == suffix)
        self._arrives = 0.0

    def put(self, payload: bytes, *, encoding: str, attachment: bytes) -> None:
        """Put a setpoint; it arrives a little later, in order, unless its client is dead by then."""
        loop = asyncio.get_running_loop()
        self._arrives = max(self._arrives, loop.time() + self._client.rng.uniform(*WAY))
        loop.call_at(self._arrives, self._client.arrived, self._kind, payload, attachment)


class CockpitClient:
    """A program on the bus of a cockpit.

    Attributes:
        is_alive: its process lives: what it puts arrives.
    """

    def __init__(self, flown: Cockpit, name: str, rng: random.Random) -> None:
        self.name, self.rng = name, rng
        self.is_alive = True
        self._flown = flown

    def stream(self, suffix: str) -> _Stream:
        """Make a publisher; see `Transport.stream`."""
        return _Stream(self, suffix)

    def arrived(self, kind: Any, payload: bytes, proof: bytes) -> None:
        """Bring a setpoint to control."""
        if self.is_alive:
            self._flown.bus.deliver(kind, asyncio.get_running_loop().time(), payload, proof)

    async def command(self, target: str, name: str, fields: Mapping[str, Any], *, patience: float = 0.0) -> Answer:
        """Carry out a request about the lease; see `Transport.command`.

        Raises:
            MkError: the program is dead: no answer comes.
        """
        await asyncio.sleep(self.rng.uniform(*WAY))
        if not self.is_alive:
            await asyncio.sleep(patience)
            raise MkError("no answer")
        state = await self._flown.flight.lease(LeaseRequest.model_validate(dict(fields)))
        return Answer(Status.ACCEPTED, {} if state is None else state.model_dump())

    @asynccontextmanager
    async def lease(self, session: FlightSession | None = None) -> AsyncIterator[Lease]:
        """Hold the lease; see `uav.lease()`.

        Raises:
            CommandRejectedError: it was refused.
        """
        queue: asyncio.Queue[Sample] = asyncio.Queue()

        def follow(suffix: str, value: BaseModel) -> None:
            if suffix in HEARD:
                queue.put_nowait(Sample(suffix, value.model_dump(mode="json"), encoding_of(type(value))))

        session = session or FlightSession()
        session.take()
        self._flown.bus.followers.append(follow)
        try:
            granted = await self._flown.flight.lease(LeaseRequest(action="take", holder=self.name))
            assert isinstance(granted, LeaseGrant)
            transport = cast("Transport", self)
            session.granted(HolderGrant(**dict(granted)), asyncio.get_running_loop().time())
            async with Lease(transport, self.name, session, _listen(queue)) as lease:
                yield lease
        finally:
            self._flown.bus.followers.remove(follow)

    def die(self) -> None:
        """End the process: nothing that it puts arrives any more."""
        self.is_alive = False


async def _listen(queue: asyncio.Queue[Sample]) -> AsyncIterator[Sample]:
    while True:
        yield await queue.get()
