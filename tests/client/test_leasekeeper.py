"""The keeper of a lease: what is under way when a flight begins or ends, in virtual time."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import pytest

from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.client.session import SessionState
from mkdaemon.errors import LeaseLostError
from mkdaemon.virtualtime import run_virtually
from tests.client.sessionlease import SessionLease

STICKS = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
ANSWERS = 0.1
"""Time that a lease takes to be granted, and to be given back [s]."""


class SlowDaemon:
    """Grants leases and takes them back after a while; `log` has both in order, with the owed releases."""

    def __init__(self, *refusals):
        self.lease, self.refusals, self.log = SessionLease(), list(refusals), []

    @asynccontextmanager
    async def take(self, session):
        await asyncio.sleep(ANSWERS)
        if self.refusals:
            raise self.refusals.pop(0)
        self.lease.epoch += 1
        self.log.append(f"granted {self.lease.epoch}")
        self.lease.grant(session)
        try:
            yield self.lease
        finally:
            await asyncio.sleep(ANSWERS)
            self.log.append("released" if session.release() else "ended by the daemon")


def story(play, *refusals):
    """Let a story happen, then close the keeper; returns what the daemon saw."""
    daemon = SlowDaemon(*refusals)

    async def main():
        keeper = LeaseKeeper(daemon.take)
        await play(keeper, daemon)
        await keeper.close()
        assert keeper.flight.state is SessionState.FREE

    run_virtually(main())
    return daemon.log


def test_a_lease_that_comes_when_it_is_not_wanted_any_more_is_given_back_at_once():
    async def play(keeper, daemon):
        keeper.begin()
        await asyncio.sleep(ANSWERS / 2)
        keeper.give_back()
        await asyncio.sleep(3 * ANSWERS)
        assert daemon.log == ["granted 8", "released"]

    assert story(play) == ["granted 8", "released"]


def test_a_flight_that_begins_while_the_last_lease_ends_gets_one_of_its_own():
    async def play(keeper, daemon):
        await keeper.take()
        keeper.give_back()
        keeper.begin()
        keeper.stream("stick", STICKS)
        assert daemon.lease.streamed == [], "nothing leaves under the lease that ends"
        await asyncio.sleep(3 * ANSWERS)
        keeper.stream("stick", STICKS)
        assert len(daemon.lease.streamed) == 1

    assert story(play) == ["granted 8", "released", "granted 9", "released"]


def test_a_lost_lease_is_taken_again_by_a_flight_that_begins_and_by_no_stream():
    async def play(keeper, daemon):
        await keeper.take()
        daemon.lease.lose("no setpoint for 1.0 s")
        for _ in range(2):
            with pytest.raises(LeaseLostError, match=r"no setpoint for 1\.0 s"):
                keeper.stream("stick", STICKS)
        await asyncio.sleep(3 * ANSWERS)
        assert daemon.log == ["granted 8"]
        await keeper.take()

    assert story(play) == ["granted 8", "ended by the daemon", "granted 9", "released"]
