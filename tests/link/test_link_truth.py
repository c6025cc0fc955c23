"""The link tells the truth within half a second, and comes back by itself; in virtual time, against the boards."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import ADAPTER_TIME, LineFault, Socket
from lab.rigs.linkrig import Log, flight_ctrl, navi_ctrl, on_line, rig, virtually
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import (
    ConfigError,
    LinkError,
    LinkLostError,
)
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.protocol.messages import (
    OsdRequestV1,
)
from mkdaemon.telemetry.link import LinkCondition

FAULTS = [
    (LineFault.BYTE_LOSS, {"degraded", "garbage"}, 0.05),
    (LineFault.BIT_FLIPS, {"degraded", "garbage"}, 0.03),
    (LineFault.STUCK_WRITER, {"down"}, 0.0),
    (LineFault.DEVICE_FULL, {"down"}, 0.0),
    (LineFault.SILENCE, {"mute"}, 0.0),
    (LineFault.ONE_WAY, {"one_way"}, 0.0),
    (LineFault.ECHO_ONLY, {"degraded"}, 0.0),
    (LineFault.GARBAGE, {"garbage"}, 0.0),
    (LineFault.TEXT_FLOOD, {"garbage"}, 0.0),
    (LineFault.REBOOT, {"mute"}, 0.0),
    (LineFault.UNPLUGGED, {"down", "absent"}, 0.0),
    (LineFault.GONE_DURING_WRITE, {"down", "absent"}, 0.0),
]
OF_THE_BOARD = {LineFault.BYTE_LOSS, LineFault.SILENCE, LineFault.ONE_WAY, LineFault.ECHO_ONLY, LineFault.REBOOT}
"""What is said of a board is its own; what is said of the port is the same before each board."""


@pytest.mark.parametrize(
    ("make", "phase", "fault", "words", "amount"),
    [
        *((navi_ctrl(), 0.013, *case) for case in FAULTS),
        *((flight_ctrl(), 0.117, *case) for case in FAULTS if case[0] in OF_THE_BOARD),
    ],
    ids=lambda value: getattr(value, "value", ""),
)
@virtually
async def test_the_right_word_within_half_a_second_and_back_again(make, phase, fault, words, amount):
    async with rig(make) as r:
        await r.until_up()
        await asyncio.sleep(1 + phase)
        r.socket.port.inject(fault, amount)
        assert await r.until(lambda: r.condition in words, 0.5) <= 0.5
        told = [s.condition.value for s in r.log.states]
        assert set(told[-1:]) <= words
        await asyncio.sleep(2.2)
        r.socket.is_present = True
        if r.socket.port.fault is not LineFault.NONE and not r.socket.port.is_closed:
            r.socket.port.inject(LineFault.NONE)
        await r.until(lambda: r.condition in ("up", "degraded") and r.log.kinds(r.log.tx[-1].at) != {}, 3)
        await r.until_up(12 if fault in (LineFault.BYTE_LOSS, LineFault.BIT_FLIPS) else 4)


@on_line(navi_ctrl())
async def test_one_byte_at_a_time_changes_nothing(r):
    r.socket.port.inject(LineFault.ONE_BYTE_AT_A_TIME)
    await asyncio.sleep(3)
    assert r.condition == "up"
    assert r.log.lost == [] or {loss.reason for loss in r.log.lost} <= {"text", "length"}


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
    for cycle in range(7):
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
    assert r.link.health().state.openings == 8


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
async def test_a_port_somebody_else_has_is_down_and_tried_again(r):
    honest, busy = r.socket.open, True

    async def contested(url: str, *, baud: int) -> object:
        if busy:
            raise LinkError(f"{url} is in use by minicom (process 7): end that program, or give it another port")
        return await honest(url, baud=baud)

    r.link._opener = contested
    r.socket.port.lose("reset")
    await asyncio.sleep(1)
    assert r.condition == "down"
    assert "minicom" in r.link.health().state.reason
    busy = False
    await r.until_up(3)


def test_impossible_configurations_are_refused_before_anything_runs():
    with pytest.raises(ConfigError):
        Link(LinkConfig(port="usb:0"), Log())
