"""Doubles for the session of `mkctl teleop`: a lease that keeps what is streamed, in virtual time."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

from mkdaemon.cli.mkctl.teleop.session import Session
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.errors import CommandRejectedError, LeaseLostError


class FakeLease:
    """A lease that is engaged at once."""

    def __init__(self) -> None:
        self.streamed: list[tuple[str, dict[str, Any]]] = []
        self.is_engaged = True
        self.reason = "flies"
        self.epoch = 7
        self.refusal: CommandRejectedError | None = None
        self.lost: str | None = None

    def put(self, kind: str, fields: Mapping[str, Any]) -> None:
        if self.lost is not None:
            raise LeaseLostError(self.lost)
        self.streamed.append((kind, dict(fields)))

    def take_refusal(self) -> CommandRejectedError | None:
        refusal, self.refusal = self.refusal, None
        return refusal


class FakeDaemon:
    """Gives leases."""

    def __init__(self, *refusals: CommandRejectedError) -> None:
        self.lease = FakeLease()
        self.refusals = list(refusals)
        self.taken = self.given_back = 0

    @asynccontextmanager
    async def take(self) -> AsyncIterator[Any]:
        if self.refusals:
            raise self.refusals.pop(0)
        self.taken += 1
        yield self.lease
        self.given_back += 1

    def session(self) -> Session:
        return Session(LeaseKeeper(self.take))
