"""A line that dies in flight: what control does about it, and what the service manager hears meanwhile."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.linkrig import virtually
from lab.rigs.waiting import running
from lab.stories.standstills import Streamer, is_tilted
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.boards import Board
from mkdaemon.protocol.messages.flightctrl import Beep
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition

LONGEST_SILENCE = 0.5
"""A third of systemd's 2 s, less a quarter: the watchdog must see progress at every look [s]."""


@asynccontextmanager
async def flying(boards):
    """A client that streams neutral sticks for as long as the context lasts, and flies."""
    async with cockpit(boards, seed=1) as flown, running(Streamer(flown, "alice", 0.0).fly()):
        assert await flown.until(lambda: flown.flight.phase is Phase.FLYING) is not None
        yield flown


def sticks_since(flown, since):
    return [frame for frame in flown.sink.tx if frame.purpose is Purpose.SETPOINT and frame.at > since]


@pytest.mark.parametrize("fault", [LineFault.SILENCE, LineFault.ONE_WAY, LineFault.STUCK_WRITER])
@virtually
async def test_a_release_nobody_confirms_is_no_stalled_loop(fault):
    async with flying(Boards("2.12a")) as flown:
        flown.socket.port.inject(fault)
        looks = []
        for _ in range(100):
            looks.append(flown.flight.ticks)
            await asyncio.sleep(0.05)
        assert flown.flight.phase is Phase.FREE
        step = round(LONGEST_SILENCE / 0.05)
        assert all(late > early for early, late in zip(looks, looks[step:], strict=False))


@virtually
async def test_a_board_that_stopped_hearing_is_flown_again_only_with_a_new_lease():
    async with flying(Boards("2.12a")) as flown:
        loop = asyncio.get_running_loop()
        began = loop.time()
        flown.socket.port.inject(LineFault.ONE_WAY)
        assert await flown.until(lambda: flown.flight.phase is Phase.RELEASING, 2.0) is not None
        assert loop.time() - began < 1.6
        flown.socket.port.inject(LineFault.NONE)
        healed = loop.time()
        await flown.until(lambda: flown.may_fly)
        await asyncio.sleep(5.0)  # the client streams on all the while
        assert not sticks_since(flown, healed)
        assert not flown.aircraft.is_controlled


@pytest.mark.parametrize(("lasts", "flies"), [(0.9, True), (1.15, False)])
@virtually
async def test_a_second_without_the_board_ends_a_flight_and_a_burst_of_a_radio_does_not(lasts, flies):
    async with flying(Boards("2.12a")) as flown:
        flown.socket.port.inject(LineFault.SILENCE)
        await asyncio.sleep(lasts)
        assert flown.sink.states[-1].condition is LinkCondition.MUTE
        flown.socket.port.inject(LineFault.NONE)
        await asyncio.sleep(0.3)
        assert (flown.flight.phase is Phase.FLYING) is flies


@virtually
async def test_a_lease_taken_while_the_board_beeps_begins_with_neutral_sticks():
    """Who took it then flew on paper: the first frame that the board heard was a full tilt."""

    async with cockpit(Boards("2.12a"), 1) as flown:
        await flown.until(lambda: flown.link.is_up)
        await flown.link.send(Beep(duration=500, count=2), board=Board.FC)
        async with running(Streamer(flown, "client").fly()):
            assert await flown.until(lambda: flown.aircraft.is_controlled) is not None
            first = next(frame for frame in flown.sink.tx if frame.purpose is Purpose.SETPOINT)
            assert not is_tilted([first])
            assert await flown.until(lambda: is_tilted(flown.sink.tx[-1:])) is not None


@virtually
async def test_nobody_is_told_to_fly_while_the_line_waits_for_a_dead_man():
    """After a release that was not confirmed stick frames are refused for 6 s."""

    async with flying(Boards("2.12a")) as flown:
        loop = asyncio.get_running_loop()
        flown.socket.port.inject(LineFault.ECHO_ONLY)  # no confirmation comes, and yet the line works
        flown.flight.client_changed("alice", is_here=False)
        assert await flown.until(lambda: flown.flight.phase is Phase.FREE, 3.0) is not None
        quiet = loop.time()
        async with running(Streamer(flown, "bob", 0.0).fly()):
            await asyncio.sleep(4.0)
        assert flown.flight.phase is not Phase.FLYING
        assert not sticks_since(flown, quiet)
