from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from lab.rigs.handpad import HandKeyboard, HandPad
from mkdaemon.cli.mkctl.teleop.session import PERIOD, TeleopSession
from mkdaemon.errors import CommandRejectedError
from mkdaemon.virtualtime import run_virtually
from tests.cli.teleop.rig import FakeDaemon

HELD = CommandRejectedError("lease_held", "somebody flies.", "wait")


def fly(daemon: FakeDaemon, story: Callable[[TeleopSession, HandPad], Awaitable[None]]) -> TeleopSession:
    """Plug a pad in, make it ready, press its enable button, and let the story happen."""

    async def main() -> TeleopSession:
        session, stop = daemon.session(), asyncio.Event()
        running = asyncio.create_task(session.run(stop))
        pad = HandPad(session)
        pad.plug_in()
        await asyncio.sleep(0.05)
        pad.move(ABS_Y=1.0)
        pad.move(ABS_Y=0.0, BTN_TL=1)
        await asyncio.sleep(0.1)
        await story(session, pad)
        stop.set()
        await running
        return session

    return run_virtually(main())


async def nothing(session: TeleopSession, pad: HandPad) -> None:
    await asyncio.sleep(1.0)


def test_enable_button_takes_the_lease_and_the_end_gives_it_back() -> None:
    daemon = FakeDaemon()
    fly(daemon, nothing)
    assert (daemon.taken, daemon.given_back) == (1, 1)
    assert len(daemon.lease.streamed) == pytest.approx(1.1 / PERIOD, abs=3)


def test_change_is_streamed_at_once_and_not_at_the_next_period() -> None:
    daemon = FakeDaemon()

    async def story(session: TeleopSession, pad: HandPad) -> None:
        await asyncio.sleep(0.0155)
        before = len(daemon.lease.streamed)
        pad.move(ABS_RX=1.0)
        await asyncio.sleep(0.011)
        assert [fields["roll"] for _, fields in daemon.lease.streamed[before:]][:1] == [30.0]

    fly(daemon, story)


def test_unplugged_pad_gives_the_lease_back_at_once() -> None:
    daemon = FakeDaemon()

    async def story(session: TeleopSession, pad: HandPad) -> None:
        pad.unplug(is_noticed=True)
        await asyncio.sleep(0.03)
        assert daemon.given_back == 1

    assert "unplugged" in fly(daemon, story).notice


def test_lost_lease_ends_the_flight_until_the_enable_button_is_pressed_anew() -> None:
    daemon = FakeDaemon()

    async def story(session: TeleopSession, pad: HandPad) -> None:
        daemon.lease.lose("somebody took it")
        await asyncio.sleep(0.1)
        assert "somebody took it" in session.output.reason
        await asyncio.sleep(0.5)
        assert daemon.taken == 1
        pad.move(BTN_TL=0)
        pad.move(BTN_TL=1)
        await asyncio.sleep(0.1)
        assert daemon.taken == 2

    fly(daemon, story)


def test_refused_lease_is_told_and_not_asked_for_again() -> None:
    daemon = FakeDaemon(HELD)
    session = fly(daemon, nothing)
    assert "lease_held" in session.notice
    assert daemon.taken == 0


def test_refused_setpoint_is_told() -> None:
    daemon = FakeDaemon()

    async def story(session: TeleopSession, pad: HandPad) -> None:
        daemon.lease.refuse(CommandRejectedError("no_estimate", "no target is seen.", "fly over one"))
        await asyncio.sleep(0.1)

    assert "no target is seen" in fly(daemon, story).notice


def test_alarm_shakes_every_pad_and_reports_and_loss_of_an_unknown_device_change_nothing() -> None:
    async def story(session: TeleopSession, pad: HandPad) -> None:
        session.reported("other", "ABS_X", 1.0, session.now)
        session.lost("other", "gone")
        await asyncio.sleep(0.1)
        assert session.teleop.pilot == "pad"
        session.alarm("the link is down")
        assert pad.alarms == 1

    assert fly(FakeDaemon(), story).notice == "the link is down"


def test_released_keyboard_has_its_enable_button_off() -> None:
    daemon = FakeDaemon()

    async def main() -> None:
        session, stop = daemon.session(), asyncio.Event()
        running = asyncio.create_task(session.run(stop))
        keyboard = HandKeyboard(session)
        keyboard.plug_in()
        await asyncio.sleep(0.05)
        keyboard.type("e")
        await asyncio.sleep(0.1)
        assert daemon.lease.streamed
        keyboard.type(" ")
        await asyncio.sleep(0.1)
        assert not keyboard.keys.is_enabled
        assert daemon.given_back == 1
        stop.set()
        await running

    run_virtually(main())
