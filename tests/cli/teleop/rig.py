"""Doubles for the session of `mkctl teleop`: a lease that keeps what is streamed, in virtual time."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.client.session import FlightSession
from mkdaemon.errors import CommandRejectedError
from tests.client.sessionlease import SessionLease


class FakeDaemon:
    """Gives leases, which are engaged at once."""

    def __init__(self, *refusals: CommandRejectedError) -> None:
        self.lease = SessionLease()
        self.refusals = list(refusals)
        self.taken = self.given_back = 0

    @asynccontextmanager
    async def take(self, session: FlightSession) -> AsyncIterator[Any]:
        if self.refusals:
            raise self.refusals.pop(0)
        self.taken += 1
        self.lease.grant(session)
        yield self.lease
        self.given_back += 1

    def session(self) -> TeleopSession:
        return TeleopSession(LeaseKeeper(self.take))
