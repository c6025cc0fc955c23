"""A verdict on the wire is given for time in which this program ran; in virtual time, against the simulated boards."""

from __future__ import annotations

import asyncio
import random

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import flight_ctrl, navi_ctrl, rig, virtually
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.virtualtime import VirtualLoop

OURS = "this program did not run"


async def be_busy(loop: VirtualLoop, seconds: float, longest: float, seed: int) -> None:
    """Keep the loop from running again and again, as other programs do that take the processor."""
    chance = random.Random(seed)
    end = loop.time() + seconds
    while loop.time() < end:
        loop.let_pass(chance.uniform(0.0, longest))
        await asyncio.sleep(chance.uniform(0.001, 0.06))


@pytest.mark.parametrize(("board", "longest"), [(navi_ctrl, 0.45), (flight_ctrl, 0.9)])
@virtually
async def test_a_busy_machine_is_never_told_as_a_fault_of_the_wire(board, longest):
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    async with rig(board()) as r:
        await r.until_up()
        await asyncio.sleep(3.0)
        before = len(r.log.healths)
        await be_busy(loop, 20.0, longest, seed=1)
        states = [health.state for health in r.log.healths[before:]]
        assert {state.condition for state in states} <= {LinkCondition.UP, LinkCondition.DEGRADED}
        said = {state.reason for state in states if state.condition is not LinkCondition.UP}
        assert all(OURS in reason for reason in said), said


@pytest.mark.parametrize(
    ("fault", "condition"), [(LineFault.SILENCE, LinkCondition.MUTE), (LineFault.ONE_WAY, LinkCondition.ONE_WAY)]
)
@virtually
async def test_a_fault_of_the_wire_is_found_on_a_busy_machine_too(fault, condition):
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    async with rig(flight_ctrl()) as r:
        await r.until_up()
        await asyncio.sleep(3.0)
        r.socket.port.inject(fault)
        await be_busy(loop, 2.0, 0.2, seed=2)
        assert r.link.health().state.condition is condition
