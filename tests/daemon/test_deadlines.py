"""A release that is confirmed late is reported again; in virtual time."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.linkrig import virtually
from lab.stories.standstills import Streamer


@pytest.mark.parametrize("fault", [LineFault.SILENCE, LineFault.UNPLUGGED])
@virtually
async def test_a_release_that_is_confirmed_later_is_reported_again(fault, monkeypatch):
    async with cockpit(Boards("2.12a"), 1) as flown:
        reported = []
        monkeypatch.setattr(
            flown.flight._audit,
            "report",
            lambda one, at: reported.append((one.action, one.released)) if hasattr(one, "action") else None,
        )
        monkeypatch.setattr(
            flown.flight._audit, "failsafe", lambda action, reason, released=None: reported.append((action, released))
        )
        flying = asyncio.create_task(Streamer(flown, "client").fly(), name="client")
        await flown.until(lambda: flown.aircraft.is_controlled)
        flown.socket.port.inject(fault)
        await flown.until(lambda: ("release", False) in reported)
        assert ("late release", True) not in reported
        flying.cancel()
        flown.socket.is_present = True
        flown.socket.port.inject(LineFault.NONE)
        assert await flown.until(lambda: reported[-1] == ("late release", True)) is not None
        assert reported.count(("late release", True)) == 1
