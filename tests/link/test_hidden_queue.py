"""Stick frames that nobody knows to have left: none is written into a serial server that may stand still."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import flight_ctrl, navi_ctrl, rig, virtually
from lab.rigs.sticks import build_sticks


async def fly(r, seconds):
    """Steer at 50 Hz, whatever becomes of the frames."""
    loop = asyncio.get_running_loop()
    end = loop.time() + seconds
    while loop.time() < end:
        sticks = build_sticks(r.link.dialect.extern_control, pitch=30)
        r.link.send_setpoint(sticks, deadline=loop.time() + 0.1)
        await asyncio.sleep(0.02)


def written(r, since):
    """Tilted frames that went to the port."""
    sticks = [sent for sent in r.log.tx if sent.message is not None and sent.message.spec.id == "b"]
    return [sent for sent in sticks if sent.at >= since and sent.message.pitch]


@pytest.mark.parametrize(
    ("board", "fault", "most"),
    [(navi_ctrl, LineFault.SILENCE, 10), (flight_ctrl, LineFault.ONE_WAY, 25)],
    ids=["stands still", "takes nothing"],
)
@virtually
async def test_a_serial_server_that_stands_still_gathers_few_stick_frames(board, fault, most):
    loop = asyncio.get_running_loop()
    async with rig(board(), port="tcp:serial.server:7") as r:
        await r.until(lambda: r.link.dialect.extern_control is not None, 5)
        await asyncio.sleep(1.0)
        await fly(r, 1.0)
        steady = len(written(r, loop.time() - 0.5))
        assert steady >= 19  # 40 Hz behind a NaviCtrl
        since = loop.time()
        r.socket.port.inject(fault)
        await fly(r, 4.0)
        assert len(written(r, since)) <= most
        r.socket.port.inject(LineFault.NONE)
        await asyncio.sleep(2.0)
        since = loop.time()
        await fly(r, 0.5)
        assert len(written(r, since)) >= 19
