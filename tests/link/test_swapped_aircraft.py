"""Another aircraft on the same cable: nothing known of the first one is used; in virtual time, against the boards."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import Rig, navi_ctrl, rig, virtually
from lab.stories.swaps import fly_as_allowed
from mkdaemon.link.session.identity import GAP
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2

LAYOUTS = {"2.12a": ExternControlV2, "2.08": ExternControlV1}
SIM = {"gate_parameter": 200}


def valid_frames(r: Rig, since: float) -> list[type]:
    """Layout of every frame with the valid bit that went out since a time [s]."""
    frames = [s.message for s in r.log.tx if s.at >= since and s.message is not None and s.message.spec.id == "b"]
    return [type(message) for message in frames if int(message.config) & 1]


async def swap_by_cable(r: Rig, word: str) -> None:
    r.socket.unplug()
    await asyncio.sleep(0.4)
    r.socket.replace(navi_ctrl("0.24", word, **SIM))
    r.socket.is_present = True


async def swap_behind_an_open_port(r: Rig, word: str) -> None:
    r.socket.port.inject(LineFault.SILENCE)
    await asyncio.sleep(GAP + 0.05)
    r.socket.replace(navi_ctrl("0.24", word, **SIM))
    r.socket.port.inject(LineFault.NONE)


@pytest.mark.parametrize("swap", [swap_by_cable, swap_behind_an_open_port])
@virtually
async def test_no_frame_in_the_layout_of_the_aircraft_before(swap):
    loop = asyncio.get_running_loop()
    async with rig(navi_ctrl("0.24", "2.12a", **SIM)) as r, asyncio.TaskGroup() as tasks:
        await r.until(lambda: r.link.dialect.extern_control is ExternControlV2, 5)
        flying = tasks.create_task(fly_as_allowed(r))
        for word in ("2.08", "2.12a"):
            await asyncio.sleep(2.0)  # after a look behind the NaviCtrl a silence is our own doing
            await swap(r, word)
            if swap is swap_by_cable:
                await r.until(lambda: r.link.doubt is not None and r.link.doubt.token == "other_aircraft", 20)
                r.link.accept_aircraft()
            swapped = loop.time()
            await r.until(lambda swapped=swapped: valid_frames(r, swapped) != [], 20)
            await asyncio.sleep(1.0)
            assert set(valid_frames(r, swapped)) == {LAYOUTS[word]}
            assert str(r.link.dialect.fc_release).startswith(word)
        flying.cancel()
