"""Whoever wants to act waits until the aircraft is known, hears why it is not, and is measured over a slow path."""

from __future__ import annotations

import asyncio
import math
from types import SimpleNamespace

import pytest

from lab.rigs.linkrig import virtually
from mkdaemon.control.admission.beginnings import TakeLease
from mkdaemon.control.admission.rows import refusal
from mkdaemon.daemon.discovery import require_discovery, require_flightctrl
from mkdaemon.daemon.pathdelay import WAITING, PathProbe
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import Token, refuse
from tests.control.admission.situations import GOOD
from tests.control.events import link_state


def line(*, is_up, boards=(), doubt=None):
    dialect = SimpleNamespace(read_only_reason="nobody has named a release")
    return SimpleNamespace(
        dialect=dialect,
        is_up=is_up,
        boards=frozenset(boards),
        is_discovering=True,
        offered_memory=lambda: None,
        doubt=doubt,
    )


DOUBT = refuse(Token.OTHER_AIRCRAFT, port="/dev/pts/3", detail="fc has release 2.08a, before 2.12a")


@pytest.mark.parametrize(
    ("state", "doubt", "token", "words"),
    [
        (None, None, "link_down", "the link is absent"),
        (link_state(LinkCondition.DOWN, "the device was unplugged"), None, "link_down", "down: the device was"),
        (link_state(LinkCondition.DOWN, "another aircraft"), DOUBT, "other_aircraft", "came back with fc has release"),
    ],
)
@virtually
async def test_on_a_line_that_is_down_or_leads_to_another_aircraft_nobody_waits(state, doubt, token, words):
    with pytest.raises(CommandRejectedError, match=words) as caught:
        await require_discovery(line(is_up=False, doubt=doubt), state)
    assert caught.value.token == token
    assert asyncio.get_running_loop().time() == 0.0


@virtually
async def test_an_aircraft_that_names_itself_meanwhile_is_waited_for():
    link = line(is_up=True)
    asyncio.get_running_loop().call_later(1.0, lambda: setattr(link, "is_discovering", False))
    await require_discovery(link, link_state())
    assert 1.0 <= asyncio.get_running_loop().time() < 1.2


class Remembering:
    """A line behind whose NaviCtrl a FlightCtrl cannot be asked."""

    def __init__(self, memory, *, is_readable=True):
        self.dialect = SimpleNamespace(
            read_only_reason=None if is_readable else "the FlightCtrl is unknown", extern_control=None
        )
        self.is_up, self.boards, self.is_discovering = True, frozenset({Board.NC}), not is_readable
        self.memory, self.is_confirmed, self.doubt = memory, False, None

    def offered_memory(self):
        return self.memory

    def confirm_memory(self):
        self.is_confirmed = True


FLIGHT = SimpleNamespace(firmware="2.12a")


@virtually
async def test_a_remembered_flightctrl_is_steered_only_when_a_client_confirms_it():
    link = Remembering(FLIGHT, is_readable=False)
    with pytest.raises(CommandRejectedError, match=r"FlightCtrl 2\.12a") as caught:
        await require_flightctrl(link, link_state(), use_remembered=False)
    assert (caught.value.token, link.is_confirmed) == ("remembered_only", False)
    await require_flightctrl(link, link_state(), use_remembered=True)
    assert link.is_confirmed


@virtually
async def test_without_a_memory_or_a_line_the_refusal_says_so_whatever_is_confirmed():
    with pytest.raises(CommandRejectedError, match="the FlightCtrl is unknown") as caught:
        await require_flightctrl(Remembering(None, is_readable=False), link_state(), use_remembered=False)
    assert caught.value.token == "discovering"
    known = Remembering(None)  # it takes no sticks: that is left to the flight core
    await require_flightctrl(known, link_state(), use_remembered=False)
    lost = Remembering(FLIGHT, is_readable=False)
    lost.is_up, lost.boards = False, frozenset()
    with pytest.raises(CommandRejectedError) as caught:
        await require_flightctrl(lost, link_state(LinkCondition.DOWN, "unplugged"), use_remembered=True)
    assert caught.value.token == "link_down"
    assert not known.is_confirmed and not lost.is_confirmed


class Time:
    """A clock that is set."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Time()


@pytest.fixture
def probe(clock):
    return PathProbe(clock)


def test_an_echo_that_comes_late_says_how_late(probe, clock):
    echo = probe.new_echo()
    clock.now += 2.05
    error = refusal(TakeLease(path_delay=probe.delay(echo), is_early=True), GOOD)
    assert error.token == Token.SLOW_PATH
    assert "takes 2.05 s, more than 0.5 s" in error.reason
    assert "max_path_delay" in error.fix


def test_echoes_that_never_come_back_fill_no_memory(probe):
    first = probe.new_echo()
    last = [probe.new_echo() for _ in range(WAITING)][-1]
    assert probe.delay(last) == 0.0
    assert probe.delay(first) == math.inf
