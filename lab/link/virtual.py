"""The cases of `python -m lab link` in virtual time: exact, seeded, undisturbed by whatever else this machine does."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final

from lab.link.cases import Case
from lab.rigs.boardport import TICK_TIME
from lab.rigs.linkrig import Rig, rig
from lab.rigs.sticks import build_sticks
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import ConfigError
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import LinkSink, SetpointQueued
from mksim.config import PilotPlan, SimConfig
from mksim.simulation import Simulation

FASTEST_SPACED: Final = 60.0
"""More stick frames a second do not keep the gap that a FlightCtrl needs in flight [Hz]."""


def configurations(case: Case) -> tuple[SimConfig, dict[str, Any]]:
    """The simulator of a case, and the link's options."""
    sim = SimConfig.model_validate({"pilot_plan": PilotPlan.NOTHING, "calibrated": True, "connect": (), **case.sim})
    options = {"rates": case.streams, "echo_hz": case.echo_hz, "window": 120.0}
    if case.setpoint_hz:
        options["setpoint_hz"] = max(case.setpoint_hz, LinkConfig().setpoint_hz)
    if case.setpoint_hz > FASTEST_SPACED:
        options["gap_ms"] = 5.0  # at rest nothing is lost so; the experiment of 2010 asks for that rate
    return sim, options


@asynccontextmanager
async def running_link(
    case: Case, boards: Simulation, options: dict[str, Any], sink: LinkSink | None = None
) -> AsyncIterator[Rig]:
    """A link that runs and knows the boards of a case, in the time of the running loop.

    Raises:
        ConfigError: the case steers, and the FlightCtrl's release stays unknown.
    """
    async with rig(lambda: boards, seed=0, sink=sink, tick=TICK_TIME, **options) as running:
        await asyncio.sleep(case.settle)
        for _ in range(100):
            if not case.setpoint_hz or running.link.dialect.extern_control is not None:
                break
            await asyncio.sleep(0.05)
        else:
            reason = running.link.dialect.read_only_reason
            raise ConfigError(f"the simulator's FlightCtrl was not recognised: {reason}")
        yield running


async def steer_steadily(link: Link, case: Case, seconds: float) -> list[float]:
    """Hand in the setpoints of a case for a time [s], or wait where it has none; returns when each was [s]."""
    loop = asyncio.get_running_loop()
    began, handed_in = loop.time(), list[float]()
    layout = link.dialect.extern_control
    for step in range(int(case.setpoint_hz * seconds)):
        assert layout is not None
        await asyncio.sleep(max(0.0, began + step / case.setpoint_hz - loop.time()))
        handed_in.append(loop.time())
        setpoint = build_sticks(layout, pitch=step % 21 - 10)
        fate = link.send_setpoint(setpoint, deadline=loop.time() + 0.1)
        assert isinstance(fate, SetpointQueued)
    await asyncio.sleep(began + seconds - loop.time())
    return handed_in
