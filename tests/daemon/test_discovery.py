"""Whoever wants to act waits until the aircraft is known, and hears why it is not."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from lab.rigs.linkrig import virtually
from mkdaemon.daemon.discovery import require_discovery
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.discovery import DISCOVERY_TIME
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.link import LinkCondition
from tests.control.events import link_state


def line(*, is_up, boards=(), lacks_flightctrl=False):
    dialect = SimpleNamespace(read_only_reason="nobody has named a release")
    return SimpleNamespace(
        dialect=dialect,
        is_up=is_up,
        boards=frozenset(boards),
        lacks_flightctrl=lacks_flightctrl,
        offered_memory=lambda: None,
    )


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (None, "the link is absent"),
        (link_state(LinkCondition.DOWN, "the device was unplugged"), "down: the device was"),
    ],
)
@virtually
async def test_on_a_line_that_is_down_nobody_waits(state, words):
    with pytest.raises(CommandRejectedError, match=words) as caught:
        await require_discovery(line(is_up=False), state)
    assert caught.value.token == "link_down"
    assert asyncio.get_running_loop().time() == 0.0


@virtually
async def test_an_aircraft_that_names_itself_meanwhile_is_waited_for():
    link = line(is_up=True)
    asyncio.get_running_loop().call_later(1.0, lambda: setattr(link, "boards", frozenset({Board.FC})))
    await require_discovery(link, link_state())
    assert 1.0 <= asyncio.get_running_loop().time() < 1.2


@virtually
async def test_an_aircraft_that_does_not_name_itself_is_refused_with_what_is_missing():
    link = line(is_up=True, boards=[Board.NC], lacks_flightctrl=True)
    with pytest.raises(CommandRejectedError, match="nobody has named a release") as caught:
        await require_discovery(link, link_state())
    assert caught.value.token == "discovering"
    assert asyncio.get_running_loop().time() == pytest.approx(DISCOVERY_TIME, abs=0.1)
