"""What the guard hears from a link: it is armed by the first stick frame, disarmed by the release, and never needed."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import Log, flight_ctrl, navi_ctrl, rig, virtually
from lab.rigs.sticks import build_sticks
from lab.rigs.virtualguard import VirtualGuard
from mkdaemon.link.session.traffic import Purpose


async def fly(r, seconds, **fields):
    """Stick frames at 50 Hz."""
    for _ in range(round(seconds / 0.02)):
        build = build_sticks(r.link.dialect.extern_control, throttle=60, **fields)
        r.link.send_setpoint(build, deadline=asyncio.get_running_loop().time() + 0.1)
        await asyncio.sleep(0.02)


def aircraft(word, nc):
    return navi_ctrl(nc, word, gate_parameter=200) if nc else flight_ctrl(word, gate_parameter=200)


@pytest.mark.parametrize(("word", "nc"), [("early", None), ("2.08", None), ("2.12a", None), ("2.12a", "0.24")])
@virtually
async def test_an_ordinary_flight_and_its_release_need_no_guard(word, nc):
    guard = VirtualGuard()
    async with rig(aircraft(word, nc), guard=guard) as r:
        await r.until(lambda: r.link.dialect.extern_control is not None and r.link.is_up, 5)
        await asyncio.sleep(1.0)
        assert not guard.guard.is_armed, "nobody has flown"
        await fly(r, 2.0, pitch=20)
        assert guard.guard.is_armed
        await r.link.release("test")
        await asyncio.sleep(0.1)
        assert not guard.guard.is_armed
    guard.stop()
    assert guard.written == []


@virtually
async def test_behind_a_stick_frame_that_does_not_leave_no_second_one_waits_and_a_release_throws_it_away():
    async with rig(flight_ctrl("2.12a", gate_parameter=200)) as r:
        await r.until(lambda: r.link.dialect.extern_control is not None and r.link.is_up, 5)
        await asyncio.sleep(1.0)
        await fly(r, 1.0, pitch=20)
        port = r.socket.port
        port.inject(LineFault.STUCK_WRITER)
        stuck_at = asyncio.get_running_loop().time()
        await fly(r, 0.4, pitch=40)
        waiting = [frame for frame in r.log.tx if frame.purpose is Purpose.SETPOINT and frame.at >= stuck_at]
        assert len(waiting) == 1
        assert port.discarded == 0
        releasing = asyncio.ensure_future(r.link.release("test"))
        await asyncio.sleep(0.01)
        assert port.discarded >= len(waiting[0].raw)
        port.inject(LineFault.NONE)
        await releasing
        await fly(r, 0.2, pitch=10)
        assert sum(frame.at > stuck_at + 0.4 and frame.purpose is Purpose.SETPOINT for frame in r.log.tx) >= 5


@pytest.mark.parametrize("word", ["early", "2.08", "2.12a"])
@virtually
async def test_frames_of_the_guard_release_the_flightctrl_when_the_link_falls_silent(word):
    guard = VirtualGuard()
    async with rig(flight_ctrl(word, gate_parameter=200), guard=guard) as r:
        guard.write = lambda data: r.socket.aircraft.write(data, r.socket.now())
        await r.until(lambda: r.link.dialect.extern_control is not None and r.link.is_up, 5)
        await asyncio.sleep(1.0)
        await fly(r, 1.0, pitch=20)
        began = asyncio.get_running_loop().time()
        assert r.socket.aircraft.flight.core.controlled
        await asyncio.sleep(2.0)
        external = r.socket.aircraft.flight.external
        assert not external.is_valid
        neutral = next(at for at, data in guard.written)
        assert neutral - began <= 0.35
        assert guard.guard.release_sent >= 20
    guard.stop()


@virtually
async def test_a_lost_port_disarms_the_guard():
    guard = VirtualGuard()
    async with rig(flight_ctrl(gate_parameter=200), guard=guard) as r:
        await r.until_up()
        await asyncio.sleep(0.5)
        await fly(r, 0.5)
        assert guard.guard.is_armed
        r.socket.unplug()
        await r.until(lambda: not guard.guard.is_armed, 2.0)
    guard.stop()


class BrokenLog(Log):
    """A sink with a defect: it fails when it hears of something received, and, if that lasts, of what is sent, too."""

    def __init__(self, *, is_lasting: bool) -> None:
        super().__init__()
        self.is_broken, self.is_lasting = False, is_lasting

    def received(self, frame):
        super().received(frame)
        if self.is_broken:
            self.is_broken = self.is_lasting
            raise RuntimeError("a defect")

    def sent(self, frame):
        super().sent(frame)
        if self.is_broken:
            raise RuntimeError("a defect")


@pytest.mark.parametrize("is_lasting", [False, True])
@virtually
async def test_a_defect_that_ends_the_link_in_flight_is_followed_by_a_release_of_the_link_or_of_the_guard(is_lasting):
    guard, sink = VirtualGuard(), BrokenLog(is_lasting=is_lasting)
    async with rig(flight_ctrl("2.08", gate_parameter=200), guard=guard, sink=sink) as r:
        guard.write = lambda data: r.socket.aircraft.write(data, r.socket.now())
        await r.until(lambda: r.link.dialect.extern_control is not None and r.link.is_up, 5)
        await asyncio.sleep(1.0)
        await fly(r, 0.5, pitch=20)
        sink.is_broken = True
        await asyncio.wait([r.task], timeout=2.0)
        assert r.task.exception() is not None
        guard.daemon_died()
        await asyncio.sleep(0.2)
        r.socket.aircraft.advance(r.socket.now())
        assert not r.socket.aircraft.flight.external.is_valid
        assert bool(guard.written) is is_lasting
    guard.stop()
