"""Each stick against the motion of the simulated aircraft: pad, session, lease, flight core, line, boards, physics."""

from __future__ import annotations

import asyncio
import math
import random

import numpy as np
import pytest

from lab.rigs.boardport import ADAPTER_TIME, Socket
from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.cockpitclient import CockpitClient
from lab.rigs.handpad import HandPad
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.telemetry.control import Phase
from mkdaemon.virtualtime import run_virtually
from mksim.config import PilotPlan, SimConfig
from mksim.simulation import Simulation

HOVERING = 9.0
"""By then the simulated pilot hovers at 2 m [s]."""
PULSES = {"ABS_Y": (-0.5, 0.25), "ABS_RY": (-0.6, 0.6), "ABS_RX": (-0.6, 0.6), "ABS_X": (-1.0, 1.0)}
"""Pushes of each stick, one to each side; thrust is stronger downwards."""


async def fly_each_stick() -> dict[str, tuple[float, float]]:
    """Fly one pulse of each stick in turn; returns the change of what it should move, for + and for -."""
    config = SimConfig(board="fc", pilot_plan=PilotPlan.SUPERVISE, pilot_wait=0.5, calibrated=True, seed=4)
    socket = Socket(lambda: Simulation(config), seed=4, tick=ADAPTER_TIME)
    found: dict[str, list[float]] = {axis: [] for axis in PULSES}
    async with cockpit(Boards("2.12a"), 4, socket=socket) as flown:
        await asyncio.sleep(HOVERING)
        session = TeleopSession(LeaseKeeper(CockpitClient(flown, "operator", random.Random(4)).lease))
        stop = asyncio.Event()
        running = asyncio.create_task(session.run(stop))
        pad = HandPad(session)
        pad.plug_in()
        await asyncio.sleep(0.1)
        pad.move(ABS_Y=1.0)
        pad.move(ABS_Y=0.0, BTN_TL=1)
        assert await flown.until(lambda: flown.flight.phase is Phase.FLYING) is not None
        await asyncio.sleep(0.5)
        for axis, pulses in PULSES.items():
            for side in pulses:
                before = measure(socket.aircraft.world.truth)[axis]
                pad.move(**{axis: side})
                await asyncio.sleep(0.5)
                after = measure(socket.aircraft.world.truth)[axis]
                found[axis].append(math.remainder(after - before, math.tau) if axis == "ABS_X" else after - before)
                if axis in {"ABS_RX", "ABS_RY"}:  # lean back to stop
                    pad.move(**{axis: -side})
                    await asyncio.sleep(0.5)
                pad.move(**{axis: 0.0})
                await asyncio.sleep(0.2)
        stop.set()
        await running
    return {axis: (low, high) for axis, (low, high) in found.items()}


def measure(truth: object) -> dict[str, float]:
    """What each stick should move: velocity forward, to the right, heading, velocity up."""
    w, x, y, z = truth.quaternion  # type: ignore[attr-defined]
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    east, north, up = np.asarray(truth.velocity_enu).tolist()  # type: ignore[attr-defined]
    forward = east * math.cos(yaw) + north * math.sin(yaw)
    right = east * math.sin(yaw) - north * math.cos(yaw)
    return {"ABS_RY": forward, "ABS_RX": right, "ABS_X": yaw, "ABS_Y": up}


@pytest.fixture(scope="module")
def changes() -> dict[str, tuple[float, float]]:
    return run_virtually(fly_each_stick())


@pytest.mark.parametrize(
    ("axis", "sign"),
    [
        ("ABS_RY", -1),  # pushed away from the operator the axis is negative: the aircraft flies forward
        ("ABS_RX", 1),  # to the right: it flies to the right
        ("ABS_X", -1),  # to the right: the nose turns right, which is negative in ENU
        ("ABS_Y", -1),  # up the axis is negative: it climbs
    ],
)
def test_stick_moves_the_aircraft_its_way(changes: dict[str, tuple[float, float]], axis: str, sign: int) -> None:
    low, high = changes[axis]
    assert sign * high > 0.05
    assert sign * low < -0.05
