"""What the daemon reads before a flight."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.cockpit import Boards, cockpit
from mkdaemon.bus.codec import encode_map
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.preflight import CheckState
from mkdaemon.virtualtime import run_virtually

STILL = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}


@pytest.mark.parametrize(("boards", "kind"), [(Boards("2.12a"), "passed"), (Boards("2.12a", "0.24"), "unknown")])
def test_the_active_set_is_read_for_the_checks_where_that_is_possible(boards, kind):
    async def story():
        async with cockpit(boards, seed=1) as flown:
            await asyncio.sleep(2.0)  # reception has been counted
            return await flown.flight.preflight()

    report = run_virtually(story())
    found = {each.name: each for each in report.findings}
    assert [
        each.token for each in report.findings if each.token not in (None, "emergency_falls", "cells_doubtful")
    ] == []
    assert found["gate"].state == found["height control"].state == kind
    assert found["firmware and layout"].state is CheckState.PASSED
    assert (found["emergency descent"].token == "emergency_falls") is (kind == "passed")


def test_in_flight_nothing_is_read():
    async def story():
        async with cockpit(Boards("2.12a"), seed=1) as flown:
            await flown.take("alice")
            for sequence in range(1, 120):
                setpoint = {"epoch": flown.epoch, "sequence": sequence, "ttl": 0.3, **STILL}
                flown.stream(encode_map(setpoint))
                await asyncio.sleep(0.02)
            assert flown.flight.phase is Phase.FLYING
            before = len(flown.sink.tx)
            report = await flown.flight.preflight()
            return report, flown.sink.tx[before:]

    report, sent = run_virtually(story())
    assert sent == []
    assert next(each for each in report.findings if each.name == "gate").state is CheckState.PASSED
