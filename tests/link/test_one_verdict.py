"""One verdict on the line that knows what we did ourselves; in virtual time, against the simulated boards."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import flight_ctrl, navi_ctrl, on_line, rig, virtually
from mkdaemon.link.session.reopening import GARBAGE_PATIENCE, PROVEN_PATIENCE, BaudSearch
from mkdaemon.link.session.verdict import HeldFinding, VerdictFinding
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.virtualtime import VirtualLoop


@virtually
async def test_looking_behind_the_navictrl_at_the_start_is_no_damage_and_nothing_is_overdue():
    async with rig(navi_ctrl()) as r:
        await r.until(lambda: r.link.dialect.fc_release is not None, 3)
        await asyncio.sleep(2.0)
        assert {state.condition.value for state in r.log.states} == {"down", "up"}


@on_line(navi_ctrl())
async def test_a_navictrl_that_boots_is_told_as_that_until_its_streams_are_back(r):
    await asyncio.sleep(3.0)
    before = len(r.log.states)
    r.socket.aircraft.world.faults.start("nc_reboot")
    await asyncio.sleep(8.0)
    said = [state for state in r.log.states[before:] if state.condition is not LinkCondition.UP]
    assert said != []
    assert all("boot" in state.reason for state in said), [state.reason for state in said]
    assert r.condition == "up"


@pytest.mark.parametrize("seconds", [0.6, 3.0])
@virtually
async def test_our_own_standstill_is_told_as_that_and_not_as_a_mute_board(seconds):
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    async with rig(flight_ctrl()) as r:
        await r.until_up()
        await asyncio.sleep(3.0)
        before = len(r.log.healths)
        loop.let_pass(seconds)
        await asyncio.sleep(4.0)
        states = [health.state for health in r.log.healths[before:]]
        assert {state.condition.value for state in states} == {"up", "degraded"}
        assert any(f"this program did not run for {seconds:.1f} s" in state.reason for state in states)
        assert r.condition == "up"


@pytest.mark.parametrize("fault", [LineFault.SILENCE, LineFault.ONE_WAY, LineFault.GARBAGE])
@on_line(flight_ctrl())
async def test_no_screen_contradicts_the_verdict(r, fault):
    await asyncio.sleep(1.0)
    r.socket.port.inject(fault)
    for _ in range(300):
        await asyncio.sleep(0.01)
        state = r.link.health().state
        assert state.hears_board is state.condition.hears_board
        assert state.board_hears_us <= state.condition.is_usable


@pytest.mark.parametrize(
    ("board", "fault", "words"),
    [
        (flight_ctrl, LineFault.SILENCE, "any more"),
        (flight_ctrl, LineFault.ONE_WAY, "RX wire"),
        (navi_ctrl, LineFault.ONE_WAY, "RX wire"),
    ],
)
@virtually
async def test_a_line_that_was_heard_is_mute_for_its_reason_long_after_its_streams_have_run_out(board, fault, words):
    async with rig(board()) as r:
        await r.until_up()
        await asyncio.sleep(1.0)
        r.socket.port.inject(fault)
        await asyncio.sleep(8.0)
        assert r.condition == "mute"
        assert words in r.link.health().state.reason
        assert fault is LineFault.ONE_WAY or r.socket.openings == 1


@on_line(navi_ctrl())
async def test_a_stream_that_comes_and_goes_is_one_verdict(r):
    await asyncio.sleep(3.0)
    before = len(r.log.states)
    for _ in range(6):
        r.socket.aircraft.world.faults.start("nc_sd_stall", duration=0.3)
        await asyncio.sleep(0.9)
    changes = [state.condition for state in r.log.states[before:]]
    assert changes == [LinkCondition.DEGRADED]


def test_a_line_proven_at_its_rate_is_searched_late():
    search = BaudSearch(57600, enabled=True)
    garbage = HeldFinding(VerdictFinding(LinkCondition.GARBAGE, "no frame"), 10.0)
    assert search.reason_to_reopen(HeldFinding(VerdictFinding(LinkCondition.UP, ""), 0.0), 0.0, 1.0) is None
    assert search.reason_to_reopen(garbage, 0.0, 10.0 + GARBAGE_PATIENCE + 0.1) is None
    assert search.reason_to_reopen(garbage, 0.0, 10.0 + PROVEN_PATIENCE + 0.1) is not None


@virtually
async def test_a_board_that_boots_without_a_word_is_not_searched_at_other_rates():
    async with rig(flight_ctrl()) as r:
        await r.until(lambda: r.socket.port is not None, 1.0)
        r.socket.port.inject(LineFault.SILENCE)
        await asyncio.sleep(5.5)
        r.socket.port.inject(LineFault.NONE)
        await r.until_up()
        assert r.socket.openings == 1
        assert not any("baud" in state.reason for state in r.log.states)
