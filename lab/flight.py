"""How the attitude loop of the simulated aircraft answers: figures read off the flying model, not off its equations."""

from __future__ import annotations

import math
from typing import Final

from lab.campaign import Row
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mksim.config import AirframeConfig, FlightConfig, LoopConfig, SensorConfig, WindClass
from mksim.physics.attitude_loop import EASY, FAST, AttitudeGains
from mksim.physics.world import DT, StartState, StickInput, World

STEP_DEG: Final = 8.0
"""Tilt step [deg]."""


def measure_step(name: str, gains: AttitudeGains, *, drag: float) -> Row:
    """Command 8 deg from a still hover and watch for four seconds.

    Returns:
        Time until the true tilt passes 63 %, overshoot of the tilt the FlightCtrl believes in, and both tilts after
        0.5, 1, 2 and 4 s.
    """
    config = FlightConfig(
        wind=WindClass.NONE,
        sensors=SensorConfig.ideal(),
        airframe=AirframeConfig(drag=drag),
        loop=LoopConfig(truncate_sticks=False),
    )
    world = World(config, seed=1, start=StartState(height=60.0), gains=gains)
    stick = math.radians(STEP_DEG) / gains.rad_per_count
    true_deg, believed_deg = [], []
    for _ in range(round(4.0 / DT)):
        world.step(StickInput(stick, 0.0, 0.0, 125.0, motors_running=True))
        true_deg.append(math.degrees(world.truth.pitch))
        believed_deg.append(math.degrees(world.sensors.fc_angle_pitch))
    t63 = next(k for k, tilt in enumerate(true_deg, 1) if tilt >= (1.0 - math.exp(-1.0)) * STEP_DEG) * DT
    when = [round(t / DT) - 1 for t in (0.5, 1.0, 2.0, 4.0)]
    return {
        "what": f"step of 8 deg, {name}, {'stick filter' if gains.ts else 'no filter'}, drag {drag}",
        "t63_s": round(t63, 3),
        "overshoot_percent": round(100 * (max(believed_deg) / STEP_DEG - 1.0)),
        "true_deg": [round(true_deg[k], 1) for k in when],
        "believed_deg": [round(believed_deg[k], 1) for k in when],
    }


def main(*, as_json: AsJson = False) -> int:
    """Measure the answer of the simulated aircraft to a tilt step; five seconds."""
    rows = [
        measure_step(name, AttitudeGains.from_parameters(**gain_set, stick_filter=stick_filter), drag=drag)
        for name, gain_set in (("easy", EASY), ("fast", FAST))
        for stick_filter in (True, False)
        for drag in (0.35, 0.18)
    ]
    return show(rows, ("what",), as_json=as_json)
