"""What the flight half of the simulator costs and how its attitude loop answers.

Speed is simulated seconds per second of one core, without a camera. The open-loop figures are read off the
flying model, not computed from its equations.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from lab.campaign import Row
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS
from mksim.boards.navictrl import NaviCtrl
from mksim.config import AirframeConfig, FlightConfig, LoopConfig, SensorConfig, WindClass
from mksim.physics.attitude_loop import EASY, FAST, AttitudeGains
from mksim.physics.hand_flight import CircleFlight
from mksim.physics.world import DT, StartState, StickInput, World

GOAL_SPEED = 30.0
"""Times real time the simulator must reach on one core without a camera."""
RUN = 60.0
"""Simulated length of a speed run [s]."""
STEP_DEG = 8.0
"""Tilt step of the open-loop figures [deg]."""
ROUNDS = 3
"""A speed is the best of this many runs: the others met somebody else on the machine."""


def measure_world(wind: WindClass) -> Row:
    """Hover under height control, sticks at rest: the physics alone."""
    sticks = StickInput(0.0, 0.0, 0.0, 125.0, motors_running=True, height_control=True)

    def fly() -> None:
        world = World(FlightConfig(wind=wind), seed=1, start=StartState(height=3.0))
        for _ in range(round(RUN / DT)):
            world.step(sticks)

    return _timed(f"world alone, {wind} wind", fly)


def measure_boards(*, with_navi: bool) -> Row:
    """Arm, take off and circle by hand over simulated boards, light wind, no serial traffic."""

    def fly() -> None:
        world = World(FlightConfig(wind=WindClass.LIGHT), seed=1)
        world.pilot.program = CircleFlight()
        flight = FlightCtrl(FC_GENERATIONS["2.12a"], world, seed=1)
        board = NaviCtrl(NC_GENERATIONS["0.24"], flight, seed=1) if with_navi else flight
        for k in range(round(RUN / 0.1)):
            board.advance(0.1 * (k + 1))
            board.poll()

    return _timed("world, pilot, FlightCtrl" + (" and NaviCtrl" if with_navi else ""), fly)


def _timed(flight: str, fly: Callable[[], None]) -> Row:
    best = math.inf
    for _ in range(ROUNDS):
        began = time.perf_counter()
        fly()
        best = min(best, time.perf_counter() - began)
    speed = RUN / best
    return {"what": flight, "times_real_time": round(speed), "step_us": round(best / (RUN / DT) * 1e6, 1)}


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
    """Measure the simulated flight: its speed and its answer to a tilt step.

    About ten seconds.
    """
    speeds = [
        measure_world(WindClass.NONE),
        measure_world(WindClass.LIGHT),
        measure_boards(with_navi=False),
        measure_boards(with_navi=True),
    ]
    steps = [
        measure_step(name, AttitudeGains.from_parameters(**gain_set, stick_filter=stick_filter), drag=drag)
        for name, gain_set in (("easy", EASY), ("fast", FAST))
        for stick_filter in (True, False)
        for drag in (0.35, 0.18)
    ]
    return show(speeds + steps, ("what",), as_json=as_json, goal_times_real_time=GOAL_SPEED)
