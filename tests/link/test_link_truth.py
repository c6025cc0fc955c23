"""The link tells the truth within half a second, knows what it did itself, and comes back by itself.

In virtual time, against the boards."""

from __future__ import annotations

import asyncio
import random

import pytest

from lab.rigs.boardport import ADAPTER_TIME, LineFault, Socket
from lab.rigs.linkrig import Log, flight_ctrl, navi_ctrl, on_line, rig, virtually
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import LinkLostError
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.link.session.reopening import GARBAGE_PATIENCE, PROVEN_PATIENCE, BaudSearch
from mkdaemon.link.session.verdict import STUCK, HeldFinding, VerdictFinding
from mkdaemon.protocol.messages import OsdRequestV1
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.virtualtime import VirtualLoop

FAULTS = [
    (LineFault.BYTE_LOSS, {"degraded", "garbage"}, 0.05, ""),
    (LineFault.BIT_FLIPS, {"degraded", "garbage"}, 0.03, ""),
    (LineFault.STUCK_WRITER, {"down"}, 0.0, STUCK),
    (LineFault.DEVICE_FULL, {"down"}, 0.0, ""),
    (LineFault.SILENCE, {"mute"}, 0.0, "nothing arrives"),
    (LineFault.ONE_WAY, {"one_way"}, 0.0, "RX wire"),
    (LineFault.ECHO_ONLY, {"degraded"}, 0.0, "is overdue"),
    (LineFault.GARBAGE, {"garbage"}, 0.0, "wrong baud"),
    (LineFault.TEXT_FLOOD, {"garbage"}, 0.0, "plain text"),
    (LineFault.REBOOT, {"mute"}, 0.0, ""),
    (LineFault.UNPLUGGED, {"down", "absent"}, 0.0, ""),
    (LineFault.GONE_DURING_WRITE, {"down", "absent"}, 0.0, ""),
]
OF_THE_BOARD = {LineFault.SILENCE, LineFault.ONE_WAY}
"""What is said of a board is its own; what is said of the port is the same before each board."""


@pytest.mark.parametrize(
    ("make", "phase", "fault", "words", "amount", "why"),
    [
        *((navi_ctrl(), 0.013, *case) for case in FAULTS),
        *((flight_ctrl(), 0.117, *case) for case in FAULTS if case[0] in OF_THE_BOARD),
    ],
    ids=lambda value: getattr(value, "value", ""),
)
@virtually
async def test_the_right_word_within_half_a_second_and_back_again(make, phase, fault, words, amount, why):
    async with rig(make) as r:
        await r.until_up()
        await asyncio.sleep(1 + phase)
        r.socket.port.inject(fault, amount)
        assert await r.until(lambda: r.condition in words, 0.5) <= 0.5
        state = r.link.health().state
        assert why in state.reason
        assert state.hears_board is state.condition.hears_board
        assert state.board_hears_us <= state.condition.is_usable, "no screen contradicts the verdict"
        told = [s.condition.value for s in r.log.states]
        assert set(told[-1:]) <= words
        await asyncio.sleep(2.2)
        r.socket.is_present = True
        if r.socket.port.fault is not LineFault.NONE and not r.socket.port.is_closed:
            r.socket.port.inject(LineFault.NONE)
        await r.until(lambda: r.condition in ("up", "degraded") and r.log.kinds(r.log.tx[-1].at) != {}, 3)
        await r.until_up(12 if fault in (LineFault.BYTE_LOSS, LineFault.BIT_FLIPS) else 4)


@on_line(navi_ctrl())
async def test_health_is_published_at_five_hertz_and_at_once_on_change(r):
    before = len(r.log.healths)
    await asyncio.sleep(4)
    assert 18 <= len(r.log.healths) - before <= 22
    r.socket.unplug()
    await asyncio.sleep(0.01)
    assert r.log.healths[-1].state.condition is LinkCondition.DOWN
    assert r.log.traffics[-1].rx_bytes > 1000


@on_line(navi_ctrl())
async def test_replugs_come_back_within_three_seconds_and_begin_with_who_is_there_and_a_release(r):
    for cycle in range(4):
        r.socket.unplug()
        await asyncio.sleep(0.2 + cycle * 0.2)
        written = len(r.socket.wire)
        if cycle % 3 == 0:
            r.socket.power_cycle()
        r.socket.is_present = True
        assert await r.until_up(3) <= 3
        letters = [raw.strip(b"\r")[2:3] for _, raw in r.socket.wire[written:]]
        assert set(letters[: letters.index(b"b")]) <= {b"v", b"o"}
        began = asyncio.get_running_loop().time()
        await r.until(lambda began=began: "O" in r.log.kinds(began), 1)
    assert r.link.health().state.openings == 5


@virtually
async def test_a_wrong_line_rate_is_found():
    async with rig(navi_ctrl(), right_baud=38400) as r:
        # an earlier session left its stream running, which lasts 4 s; somebody else renews it
        for after in (0.0, 3.0):
            request = OsdRequestV1(interval=10).to_frame()
            asyncio.get_running_loop().call_later(
                after, lambda request=request: r.socket.aircraft.write(request, r.socket.now())
            )
        await r.until(lambda: r.condition == "garbage", 1)
        await r.until(lambda: r.condition in ("up", "degraded"), 8)
        assert r.link.health().state.baud == 38400


@virtually
async def test_a_line_that_never_said_anything_is_tried_at_other_rates():
    async with rig(navi_ctrl(), right_baud=115200) as r:
        await r.until(lambda: r.condition == "mute", 0.5)
        await r.until(lambda: r.condition in ("up", "degraded"), 8)
        assert r.link.health().state.baud == 115200


@on_line(navi_ctrl(), probe_baud=False)
async def test_the_search_can_be_switched_off(r):
    r.socket.port.inject(LineFault.GARBAGE)
    await asyncio.sleep(5)
    assert r.socket.openings == 1
    assert r.condition == "garbage"


@virtually
async def test_a_port_missing_at_the_start_ends_the_run_or_is_waited_for():
    for wait in (False, True):
        log, socket = Log(), Socket(navi_ctrl(), seed=1, tick=ADAPTER_TIME)
        socket.is_present = False
        cfg = LinkConfig(port="/dev/rig", wait_for_port=wait)
        link = Link(cfg, log, opener=socket.open, clock=Clock(monotonic=asyncio.get_running_loop().time))
        task = asyncio.create_task(link.run(discover))
        await asyncio.sleep(1)
        if wait:
            assert log.states[-1].condition is LinkCondition.ABSENT
            socket.is_present = True
            await asyncio.sleep(2)
            assert link.is_up
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        else:
            with pytest.raises(LinkLostError, match="plug it in"):
                await task


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


@pytest.mark.parametrize(
    ("board", "fault", "words"),
    [
        (flight_ctrl, LineFault.SILENCE, "any more"),
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
        await be_busy(loop, 10.0, longest, seed=1)
        states = [health.state for health in r.log.healths[before:]]
        assert {state.condition for state in states} <= {LinkCondition.UP, LinkCondition.DEGRADED}
        said = {state.reason for state in states if state.condition is not LinkCondition.UP}
        assert all(OURS in reason for reason in said), said
