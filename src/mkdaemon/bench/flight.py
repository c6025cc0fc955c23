"""What the flight half of the simulator costs and how its attitude loop answers.

Speed is simulated seconds per second of one core, without boards and camera. The open-loop figures are read off the
flying model, not computed from its equations.
"""

from __future__ import annotations

import json
import math
import platform
import time
from dataclasses import asdict, dataclass

from rich.console import Console
from rich.table import Table

from mkdaemon.config.sim_flight import AirframeConfig, FlightConfig, LoopConfig, SensorConfig, WindClass
from mkdaemon.sim.attitude_loop import EASY, FAST, AttitudeGains
from mkdaemon.sim.hand_flight import HandFlight
from mkdaemon.sim.world import DT, StartState, StickInput, World

GOAL_SPEED = 30.0
"""Times real time the simulator must reach on one core without a camera."""
RUN_S = 60.0
"""Simulated length of a speed run [s]."""
STEP_DEG = 8.0
"""Tilt step of the open-loop figures [deg]."""
ROUNDS = 3
"""A speed is the best of this many runs: the others met somebody else on the machine."""


@dataclass(frozen=True, slots=True)
class Speed:
    """Cost of a kind of flight.

    Attributes:
        flight: which.
        times_real_time: simulated over real seconds.
        step_us: cost of one 2.048 ms step [us].
    """

    flight: str
    times_real_time: float
    step_us: float


@dataclass(frozen=True, slots=True)
class Step:
    """Answer to a tilt step of 8 deg in hover gas and still air.

    Attributes:
        gains: parameter set.
        stick_filter: FC >= 2.10.
        drag: of the airframe [1/s].
        t63: time until the true tilt passes 63 % [s].
        overshoot: of the tilt the FlightCtrl believes in.
        true_deg: true tilt after 0.5, 1, 2 and 4 s [deg].
        believed_deg: what the FlightCtrl believes then [deg].
    """

    gains: str
    stick_filter: bool
    drag: float
    t63: float
    overshoot: float
    true_deg: tuple[float, ...]
    believed_deg: tuple[float, ...]


def measure_speed(wind: WindClass, *, by_hand: bool) -> Speed:
    """Fly `RUN_S` in this wind, sticks at rest or the pilot's."""
    best = math.inf
    steps = round(RUN_S / DT)
    for _ in range(ROUNDS):
        world = World(FlightConfig(wind=wind), seed=1, start=StartState(height=3.0))
        if by_hand:
            world.pilot.program = HandFlight(height=3.0, flying=True)
        pilot = world.pilot
        began = time.perf_counter()
        for _ in range(steps):
            gas = 127.0 + pilot.gas if by_hand else 125.0
            pitch, roll = (float(pilot.pitch), float(pilot.roll)) if by_hand else (0.0, 0.0)
            world.step(StickInput(pitch, roll, 0.0, gas, motors_running=True, height_control=not by_hand))
        best = min(best, time.perf_counter() - began)
    name = f"{wind} wind, {'hand-flown hover' if by_hand else 'sticks at rest'}"
    return Speed(name, RUN_S / best, best / steps * 1e6)


def measure_step(name: str, gains: AttitudeGains, *, drag: float) -> Step:
    """Command 8 deg from a still hover and watch for four seconds."""
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
    return Step(
        name,
        gains.ts > 0.0,
        drag,
        t63,
        max(believed_deg) / STEP_DEG - 1.0,
        tuple(true_deg[k] for k in when),
        tuple(believed_deg[k] for k in when),
    )


def main(as_json: bool = False) -> None:
    """Measure and print, as a table or as one JSON object."""
    speeds = [
        measure_speed(WindClass.NONE, by_hand=False),
        measure_speed(WindClass.LIGHT, by_hand=False),
        measure_speed(WindClass.LIGHT, by_hand=True),
    ]
    steps = [
        measure_step(name, AttitudeGains.from_parameters(**gain_set, stick_filter=stick_filter), drag=drag)
        for name, gain_set in (("easy", EASY), ("fast", FAST))
        for stick_filter in (True, False)
        for drag in (0.35, 0.18)
    ]
    if as_json:
        result = {
            "machine": platform.machine(),
            "python": platform.python_version(),
            "goal_times_real_time": GOAL_SPEED,
            "speed": [asdict(speed) for speed in speeds],
            "step": [asdict(step) for step in steps],
        }
        Console(soft_wrap=True).print_json(json.dumps(result))
        return
    console = Console()
    table = Table("flight", "x real time", "us a step", title=f"Speed of the flight, goal {GOAL_SPEED:g}")
    for speed in speeds:
        table.add_row(speed.flight, f"{speed.times_real_time:.0f}", f"{speed.step_us:.1f}")
    console.print(table)
    table = Table(
        "set", "filter", "drag", "t63 s", "overshoot %", "true deg at 0.5 1 2 4 s", "believed deg", title="8 deg step"
    )
    for step in steps:
        table.add_row(
            step.gains,
            "yes" if step.stick_filter else "no",
            f"{step.drag:.2f}",
            f"{step.t63:.3f}",
            f"{100.0 * step.overshoot:.0f}",
            " ".join(f"{tilt:.1f}" for tilt in step.true_deg),
            " ".join(f"{tilt:.1f}" for tilt in step.believed_deg),
        )
    console.print(table)
