"""The link lets go of the aircraft for certain, and what the guard hears of it; in virtual time, against the boards."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import Log, Rig, flight_ctrl, navi_ctrl, on_line, rig, virtually
from lab.rigs.sticks import build_sticks
from lab.rigs.virtualguard import VirtualGuard
from mkdaemon.link.session.traffic import Purpose, SetpointFate, SetpointQueued, SetpointRefused
from mkdaemon.protocol.messages import DebugRequest, ExternControlV1, ExternControlV2

EVERY_FC = ("early", "2.08", "2.12a", "2.14")


def released(r: Rig) -> bool:
    """Whether the flight controller holds no valid external control."""
    return not r.socket.aircraft.flight.core.controlled


def steer(r: Rig, **fields: int) -> None:
    layout = r.link.dialect.extern_control
    assert layout is not None
    deadline = asyncio.get_running_loop().time() + 0.1
    fate = r.link.send_setpoint(build_sticks(layout, **{"throttle": 60, **fields}), deadline=deadline)
    assert isinstance(fate, SetpointQueued), fate


async def hold(r: Rig, seconds: float, **fields: int) -> None:
    for _ in range(int(seconds / 0.02)):
        steer(r, **fields)
        await asyncio.sleep(0.02)


@pytest.mark.parametrize("word", EVERY_FC)
@virtually
async def test_a_release_is_confirmed_takes_effect_and_needs_no_guard(word):
    guard = VirtualGuard()
    async with rig(flight_ctrl(word, gate_parameter=200), guard=guard) as r:
        await r.until_up()
        await asyncio.sleep(0.3)
        assert not guard.guard.is_armed, "nobody has flown"
        await hold(r, 1.0, pitch=20)
        assert guard.guard.is_armed
        assert not released(r)
        began = asyncio.get_running_loop().time()
        result = await r.link.release("test")
        assert (result.status, result.confirmed) == ("confirmed", 5)
        assert asyncio.get_running_loop().time() - began < 0.3
        await asyncio.sleep(0.6)
        assert released(r)
        assert not guard.guard.is_armed
        last = [s for s in r.log.tx if s.purpose in (Purpose.SETPOINT, Purpose.RELEASE)][-6:]
        assert last[0].message.pitch == 0
        assert int(last[0].message.config) == 1
        await hold(r, 0.2)  # and control may be taken again
    guard.stop()
    assert guard.written == []


@virtually
async def test_through_a_navictrl_a_release_is_not_observable_but_effective():
    async with rig(navi_ctrl(gate_parameter=200)) as r:
        await r.until(lambda: r.link.dialect.extern_control is not None, 3)
        await asyncio.sleep(1)
        await hold(r, 1.0, pitch=20)
        assert not released(r)
        result = await r.link.release("test")
        assert result.status == "not_observable"
        assert result.sent == 5
        await asyncio.sleep(0.6)
        assert released(r)


def refusal(fate: SetpointFate) -> str:
    """Token of the refusal; empty where the setpoint was taken."""
    return fate.refusal.token if isinstance(fate, SetpointRefused) else ""


@virtually
async def test_nothing_is_steered_during_a_release_nor_in_the_wrong_layout():
    async with rig(flight_ctrl()) as r:
        assert refusal(r.link.send_setpoint(build_sticks(ExternControlV2), deadline=1e9)) == "link_down"
        await r.until_up()
        await asyncio.sleep(0.3)
        assert refusal(r.link.send_setpoint(build_sticks(ExternControlV1), deadline=1e9)) == "wrong_layout"
        assert r.link.send_setpoint(build_sticks(ExternControlV2), deadline=1e9).number > 0
        releasing = asyncio.ensure_future(r.link.release("test"))
        await asyncio.sleep(0)
        assert refusal(r.link.send_setpoint(build_sticks(ExternControlV2), deadline=1e9)) == "releasing"
        await releasing


@pytest.mark.parametrize("word", ["early", "2.08"])
@virtually
async def test_an_unconfirmed_release_silences_what_keeps_the_sticks_alive(word):
    async with rig(flight_ctrl(word, gate_parameter=200)) as r:
        await r.until_up()
        await asyncio.sleep(0.3)
        await hold(r, 0.5, pitch=20)
        r.socket.port.inject(LineFault.ONE_WAY)
        result = await r.link.release("test")
        assert result.status == "unconfirmed"
        began = asyncio.get_running_loop().time()
        await asyncio.sleep(5.9)
        dead_man = r.link.dialect.dead_man
        after = [s for s in r.log.tx if s.at > began and s.message is not None]
        refreshing = [s for s in after if dead_man.refreshed_by(s.message.spec.id)]
        assert {s.purpose for s in refreshing} == {Purpose.RELEASE}, "nothing but further releases"
        assert len(refreshing) <= 12
        assert released(r)
        r.socket.port.inject(LineFault.NONE)
        await asyncio.sleep(4)
        assert r.log.kinds(began + 8).keys() >= {"C", "D", "V"}


@on_line(flight_ctrl())
async def test_losing_the_port_ends_a_release_that_waits(r):
    r.socket.port.inject(LineFault.ONE_WAY)
    releasing = asyncio.ensure_future(r.link.release("test"))
    await asyncio.sleep(0.1)
    r.socket.unplug()
    assert (await releasing).status == "not_sent"


@pytest.mark.parametrize("word", EVERY_FC)
@virtually
async def test_nothing_but_the_end_of_an_endless_stream_goes_beside_the_release_of_an_exit(word):
    for seed in (1, 4):
        async with rig(flight_ctrl(word, seed=seed, gate_parameter=200), seed=seed) as r:
            await r.until_up()
            await asyncio.sleep(0.3)
            await hold(r, 0.2, pitch=20)
            await asyncio.sleep(0.013 * seed)
            began = asyncio.get_running_loop().time()
        after = [s for s in r.log.tx if s.at >= began]
        others = [s.message for s in after if s.purpose is not Purpose.RELEASE]
        assert len(others) <= (word in {"2.12a", "2.14"}), seed
        assert all(isinstance(message, DebugRequest) and message.interval == 0 for message in others)
        assert (after[-1].purpose, int(after[-1].message.config)) == (Purpose.RELEASE, 0)


@on_line(flight_ctrl())
async def test_an_exit_beside_a_dead_board_is_bounded(r):
    r.socket.port.inject(LineFault.SILENCE)
    began = asyncio.get_running_loop().time()
    r.task.cancel()
    await asyncio.gather(r.task, return_exceptions=True)
    assert asyncio.get_running_loop().time() - began < 1.0


async def fly_steadily(r, seconds, **fields):
    """Steer at 50 Hz, whatever becomes of the frames."""
    for _ in range(round(seconds / 0.02)):
        build = build_sticks(r.link.dialect.extern_control, throttle=60, **fields)
        r.link.send_setpoint(build, deadline=asyncio.get_running_loop().time() + 0.1)
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
        await fly_steadily(r, 1.0, pitch=30)
        steady = len(written(r, loop.time() - 0.5))
        assert steady >= 19  # 40 Hz behind a NaviCtrl
        since = loop.time()
        r.socket.port.inject(fault)
        await fly_steadily(r, 4.0, pitch=30)
        assert len(written(r, since)) <= most
        r.socket.port.inject(LineFault.NONE)
        await asyncio.sleep(2.0)
        since = loop.time()
        await fly_steadily(r, 0.5, pitch=30)
        assert len(written(r, since)) >= 19


@virtually
async def test_behind_a_stick_frame_that_does_not_leave_no_second_one_waits_and_a_release_throws_it_away():
    async with rig(flight_ctrl("2.12a", gate_parameter=200)) as r:
        await r.until(lambda: r.link.dialect.extern_control is not None and r.link.is_up, 5)
        await asyncio.sleep(1.0)
        await fly_steadily(r, 1.0, pitch=20)
        port = r.socket.port
        port.inject(LineFault.STUCK_WRITER)
        stuck_at = asyncio.get_running_loop().time()
        await fly_steadily(r, 0.4, pitch=40)
        waiting = [frame for frame in r.log.tx if frame.purpose is Purpose.SETPOINT and frame.at >= stuck_at]
        assert len(waiting) == 1
        assert port.discarded == 0
        releasing = asyncio.ensure_future(r.link.release("test"))
        await asyncio.sleep(0.01)
        assert port.discarded >= len(waiting[0].raw)
        port.inject(LineFault.NONE)
        await releasing
        await fly_steadily(r, 0.2, pitch=10)
        assert sum(frame.at > stuck_at + 0.4 and frame.purpose is Purpose.SETPOINT for frame in r.log.tx) >= 5


@pytest.mark.parametrize("word", ["early", "2.12a"])
@virtually
async def test_frames_of_the_guard_release_the_flightctrl_when_the_link_falls_silent(word):
    guard = VirtualGuard()
    async with rig(flight_ctrl(word, gate_parameter=200), guard=guard) as r:
        guard.write = lambda data: r.socket.aircraft.write(data, r.socket.now())
        await r.until(lambda: r.link.dialect.extern_control is not None and r.link.is_up, 5)
        await asyncio.sleep(1.0)
        await fly_steadily(r, 1.0, pitch=20)
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
        await fly_steadily(r, 0.5)
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
        await fly_steadily(r, 0.5, pitch=20)
        sink.is_broken = True
        await asyncio.wait([r.task], timeout=2.0)
        assert r.task.exception() is not None
        guard.daemon_died()
        await asyncio.sleep(0.2)
        r.socket.aircraft.advance(r.socket.now())
        assert not r.socket.aircraft.flight.external.is_valid
        assert bool(guard.written) is is_lasting
    guard.stop()
