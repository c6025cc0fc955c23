"""A FlightCtrl flown by stick frames over a radio: the attitude goes on, requests are answered, nothing is left out."""

from __future__ import annotations

import asyncio
import itertools

from lab.rigs.linkrig import Rig, flight_ctrl, rig, virtually
from lab.rigs.sticks import build_sticks
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.telemetry.link import Fates

FLOWN = 20.0
"""Length of each flight [s]; streams live for 4.1 s."""


def radio(loss: float) -> dict[str, object]:
    return {way: {"kind": "xbee", "loss": loss} for way in ("to_board", "to_host")}


async def fly(r: Rig, rate: float) -> float:
    """Hand in setpoints steadily; returns when that began [s]."""
    await r.until(lambda: r.link.dialect.extern_control is not None, 10)
    await asyncio.sleep(2.0)
    layout, loop = r.link.dialect.extern_control, asyncio.get_running_loop()
    began = loop.time()
    for step in range(int(FLOWN * rate)):
        await asyncio.sleep(max(0.0, began + step / rate - loop.time()))
        r.link.send_setpoint(build_sticks(layout, pitch=step % 20), deadline=loop.time() + 0.1)
    return began


@virtually
async def test_by_radio_the_attitude_is_not_silent_and_requests_are_answered():
    loss = 0.10
    async with rig(flight_ctrl(seed=2, radio=radio(loss)), rates={"attitude": 50, "debug": 200}) as r:
        began = await fly(r, 40.0)
        seen = [frame.at for frame in r.log.rx if frame.frame.id == "C" and frame.at > began]
        assert max(after - before for before, after in itertools.pairwise(seen)) <= 0.8
        tests = r.link.health().link_tests
        by_radio = 1.0 - (1.0 - loss) ** 2
        assert tests.answered >= (0.95 - 1.5 * by_radio) * (tests.sent - tests.waiting)
        health = r.link.health()
        for fates in (health.link_tests, health.requests, health.stick_frames):
            assert_complete(fates)
        sticks = [s for s in r.log.tx if s.purpose in (Purpose.SETPOINT, Purpose.RELEASE)]
        assert health.stick_frames.sent == len(sticks)
        assert health.link_tests.sent == sum(s.purpose is Purpose.ECHO for s in r.log.tx)


def assert_complete(fates: Fates) -> None:
    """The parts add up to what was sent."""
    assert fates.sent == fates.answered + fates.late + fates.unanswered + fates.waiting + fates.silent
    assert fates.unanswered == fates.lost + fates.replaced + fates.outage + fates.withdrawn
    assert min(fates.model_dump().values()) >= 0
