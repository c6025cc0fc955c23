"""Who is on the line, and what lies behind a NaviCtrl: in virtual time, against the simulated boards."""

from __future__ import annotations

import asyncio
import itertools

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import flight_ctrl, navi_ctrl, on_line, rig, virtually
from lab.rigs.sticks import build_sticks
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link import discovery
from mkdaemon.link.discovery import LOOK_AGAIN, redirection, wait_for_discovery
from mkdaemon.protocol.flags import RedirectPort
from mkdaemon.protocol.messages import ControlStateRequest, ExternControlV2
from mkdaemon.protocol.messages.navictrl import ESCAPE, Redirect
from mkdaemon.protocol.wire import Board

TO_FLIGHTCTRL, TO_COMPASS = Redirect(port=RedirectPort.FC), Redirect(port=RedirectPort.MAG)


@virtually
async def test_a_navictrl_is_found_its_streams_started_and_the_flightctrl_behind_it_looked_up():
    """`u 0` stops the camera servos' timer; the escape starts it only after `u 1`: docs/firmware-notes, "Sending"."""
    async with rig(navi_ctrl()) as r:
        assert await r.until_up() <= 0.5
        await r.until(lambda: r.link.dialect.extern_control is ExternControlV2, 5)
        await asyncio.sleep(2)
        state = r.link.health().state
        assert (state.boards, state.external_control, state.redirected_to) == (("fc", "nc"), "v2", "")
        assert state.firmware.startswith("NaviCtrl 0.24")
        assert state.firmware.endswith(", FlightCtrl 2.12a")
        assert r.log.kinds(since=0.5).keys() >= {"O", "C", "D", "Z"}
        assert (r.link.direct_board, r.condition) == (Board.NC, "up")
        sent = [s.message or s.raw for s in r.log.tx if s.message in (TO_FLIGHTCTRL, TO_COMPASS, None)]
        begun = sent.index(TO_FLIGHTCTRL)
        assert sent[begun:] == [TO_FLIGHTCTRL, ESCAPE, ESCAPE, TO_COMPASS, ESCAPE, ESCAPE]


def drop(rig, what, times):
    """Lose so many portions with these bytes on their way to the boards; returns what was lost."""
    passed_on, lost = rig.socket.aircraft.write, []

    def write(data: bytes, at: float) -> None:
        if what in data and len(lost) < times:
            lost.append(at)
        else:
            passed_on(data, at)

    rig.socket.aircraft.write = write
    return lost


@virtually
async def test_a_redirection_that_the_line_lost_is_no_look_and_soon_made_again():
    async with rig(navi_ctrl()) as r:
        lost = drop(r, b"#cu", 3)
        took = await r.until(lambda: r.link.dialect.extern_control is ExternControlV2, 20)
        assert (len(lost), took < 6.0) == (3, True)


@on_line(navi_ctrl(seed=0), seed=0)
async def test_a_line_with_one_damaged_byte_in_a_hundred_does_not_ask_the_boards_anew(r):
    r.socket.port.fault, r.socket.port.amount = LineFault.BIT_FLIPS, 0.01
    await r.until(lambda: r.link.dialect.extern_control is ExternControlV2, 20)
    loop = asyncio.get_running_loop()
    end = loop.time() + 12.0
    while loop.time() < end:
        await asyncio.sleep(0.05)
        assert r.link.dialect.read_only_reason is None


@virtually
async def test_an_aircraft_that_flew_at_first_is_known_once_its_motors_stop():
    async with rig(navi_ctrl(pilot_plan="hover", pilot_wait=0.0)) as r:
        boards, loop = r.socket.aircraft, asyncio.get_running_loop()
        passed_on = boards.write
        boards.write = lambda data, at: None if b"#cu" in data else passed_on(data, at)
        await r.until(lambda: r.link.motors_running() is True, 20)
        boards.write = passed_on
        took_off = loop.time()
        await asyncio.sleep(sum(LOOK_AGAIN[:2]) + 2.0)  # when two looks would have come
        assert r.link.lacks_flightctrl
        assert not await wait_for_discovery(r.link)
        assert all(s.message.spec.id != "u" for s in r.log.tx if s.message and s.at > took_off)
        boards.world.pilot.program = None
        boards.world.faults.start("fc_reboot")
        await r.until(lambda: r.link.dialect.extern_control is ExternControlV2, 20)


@virtually
async def test_a_flightctrl_that_never_answers_is_looked_for_ever_more_seldom_and_then_no_more(monkeypatch):
    """Each look costs 0.6 s of telemetry; it went on every 15 s for ever."""
    assert list(LOOK_AGAIN) == sorted(LOOK_AGAIN)
    assert sum(LOOK_AGAIN) < 100
    pauses = (0.5, 1.0, 2.0, 4.0)
    monkeypatch.setattr(discovery, "LOOK_AGAIN", pauses)
    async with rig(navi_ctrl()) as r:
        passed_on = r.socket.aircraft.write
        r.socket.aircraft.write = lambda data, at: None if b"#bv" in data else passed_on(data, at)
        await asyncio.sleep(20)
        looks = [s.at for s in r.log.tx if s.message == TO_FLIGHTCTRL]
        assert len(looks) == 5
        between = [later - at for at, later in itertools.pairwise(looks)]
        assert all(pause < time < pause + 1.5 for time, pause in zip(between, pauses, strict=True))
        r.socket.aircraft.write = passed_on
        assert not r.link.lacks_flightctrl
        r.socket.port.lose("pulled")
        await r.until(lambda: r.link.dialect.extern_control is ExternControlV2, 10)


@on_line(navi_ctrl(), probe_flightctrl=False)
async def test_the_look_behind_can_be_switched_off(r):
    await asyncio.sleep(2)
    assert all(s.message is None or s.message.spec.id != "u" for s in r.log.tx)
    fate = r.link.send_setpoint(build_sticks(ExternControlV2), deadline=9e9)
    assert fate.refusal.token == "read_only"


@virtually
async def test_a_redirection_left_open_by_another_program_is_ended():
    async with rig(navi_ctrl()) as r:
        socket = r.socket
        await r.until_up()
        await asyncio.sleep(1)
        socket.aircraft.write(b"#cu====Dl\r", socket.now())
        await asyncio.sleep(0.1)
        socket.port.lose("pulled")
        await r.until(lambda: socket.openings == 2, 3)
        await r.until(lambda: r.link.direct_board is Board.NC and r.condition == "up", 3)


@virtually
async def test_nothing_that_could_harm_is_sent_by_itself():
    """Only these: release, version, link test, streams, redirection to the FlightCtrl, escape."""
    for make in (flight_ctrl("2.08"), flight_ctrl("2.12a"), navi_ctrl(), navi_ctrl("2.14", "2.14")):
        async with rig(make) as r:
            await r.until_up()
            await asyncio.sleep(3)
            letters = {s.message.spec.id for s in r.log.tx if s.message is not None}
            assert letters <= set("bvzocdu")


@virtually
async def test_a_redirection_leads_to_its_board_asks_once_more_whether_it_may_begin_and_ends():
    async with rig(navi_ctrl()) as r:
        await r.until(lambda: r.link.dialect.fc_release is not None, 3)
        await asyncio.sleep(1)

        def refuse():
            raise CommandRejectedError("flying", "somebody flies.", "Wait.")

        before = len(r.log.tx)
        with pytest.raises(CommandRejectedError, match="somebody flies"):
            async with redirection(r.link, Board.ANY, refuse):
                pytest.fail("the line was passed through")
        assert [s for s in r.log.tx[before:] if s.message == Redirect(port=RedirectPort.GPS)] == []
        async with redirection(r.link, Board.MAG):
            assert r.link.health().state.redirected_to == "mag"
        async with redirection(r.link, Board.FC):
            assert r.link.health().state.redirected_to == "fc"
            assert int((await r.link.request(ControlStateRequest())).config) == 0
        await asyncio.sleep(0.5)
        assert r.condition == "up"
        assert r.link.health().state.redirected_to == ""


@virtually
async def test_a_redirection_is_refused_with_motors_not_known_off_and_without_a_navictrl():
    async with rig(navi_ctrl(), rates={"attitude": 100}) as r:
        await r.until_up()
        await asyncio.sleep(2)
        with pytest.raises(CommandRejectedError) as caught:
            async with redirection(r.link, Board.FC):
                raise AssertionError
        assert caught.value.token == "motors_not_known_off"
        r.socket.port.inject(LineFault.SILENCE)
        await asyncio.sleep(1)
        with pytest.raises(CommandRejectedError) as caught:
            async with redirection(r.link, Board.FC):
                raise AssertionError
        assert (caught.value.token, "nothing arrives any more" in caught.value.reason) == ("link_down", True)
    async with rig(flight_ctrl()) as r:
        await r.until_up()
        with pytest.raises(CommandRejectedError) as caught:
            async with redirection(r.link, Board.MAG):
                raise AssertionError
        assert caught.value.token == "not_redirectable"
