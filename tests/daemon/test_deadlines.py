"""Silence is answered at its deadline, and a release that is confirmed late is reported again; in virtual time."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.linkrig import virtually
from lab.stories.deaths import Death, fly_session
from lab.stories.standstills import Streamer
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.link import LinkConfig


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


SILENT = (Death.FROZEN, Death.STALE, Death.OLD_EPOCH)
TAKEN = 1.0 / LinkConfig(port="/dev/x").setpoint_hz + 0.012
"""From the turn of a stick frame whose place a request took until the next one, 12 ms behind the request [s]."""
ON_THE_WIRE = 0.005
"""From the decision to the last character of a frame at 57600 baud [s]."""


def test_neutral_sticks_leave_when_the_setpoint_grows_too_old():
    cfg = ControlConfig()
    for loss in fly_session(Boards("2.12a"), seed=7, deaths=3, watched=1.5, ways=SILENT):
        assert loss["wire"] is not None
        # A request may have taken the place of the frame that was due: docs/safety.md promises 0.35 s.
        assert cfg.limiter.setpoint_ttl < loss["wire"] < cfg.limiter.setpoint_ttl + TAKEN + ON_THE_WIRE
        assert loss["released"] is not None
        # The board's next request for its receiver values comes between.
        assert cfg.lease.release_after < loss["released"] < cfg.lease.release_after + TAKEN + ON_THE_WIRE
