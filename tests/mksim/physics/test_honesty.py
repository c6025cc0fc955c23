"""The simulator is honest: what was lost outside in 2010 is lost in here.

The law gets exact positions while the target is in view, 15 a second, 250 ms late; heading and height are held for it,
so that only the horizontal law is on trial. That a law which models the loop is not lost in the same world is what
`tests/mksim/programs/test_rehearsal.py` and every flight of the daemon show.

The gains of 2010 are drawn from 2 to 80 counts a metre. Below 0.9 the equations are stable in still air, by drag alone
and with a bandwidth of 0.15 rad/s; such a law loses the target in the first wind (second test).
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable

import pytest

from mksim.config import FlightConfig, WindClass
from mksim.physics.world import StartState, StickInput, World

DELAY = 0.250
RATE = 15.0
LOST_AT = 15.0
HEIGHT = 3.0
VIEW = 0.75 * HEIGHT
"""The camera sees 74 degrees."""
Law = Callable[[float, tuple[float, float] | None], tuple[float, float]]
"""Time and a new late position (or None) to the pitch and roll sticks [count], nose towards east."""


def is_lost(law: Law, *, seed: int, wind: WindClass, duration: float) -> bool:
    """Fly a law around the origin until it is lost or the time is over."""
    world = World(FlightConfig(wind=wind), seed=seed, start=StartState(height=HEIGHT, yaw=0.0))
    hover = FlightConfig().airframe.hover_count
    pending: deque[tuple[float, tuple[float, float]]] = deque()
    next_shot = next_command = 0.0
    pitch = roll = 0.0
    while world.now < duration:
        now = world.now
        east, north, up = (float(x) for x in world.truth.position_enu)
        away = math.hypot(east, north)
        if away > LOST_AT or world.truth.crashed or world.truth.on_ground or math.degrees(world.truth.tilt) > 75.0:
            return True
        assert up < 20.0, "height control must hold the height for the law on trial"
        if now >= next_shot:
            next_shot += 1.0 / RATE
            if away < VIEW:
                pending.append((now + DELAY, (east, north)))
        if now >= next_command:
            next_command += 0.02
            pitch, roll = law(now, pending.popleft()[1] if pending and pending[0][0] <= now else None)
        world.step(StickInput(pitch, roll, 0.0, hover, motors_running=True, height_control=True))
    return False


def pi_of_2010(kp: float, ki: float) -> Law:
    """PI on the late offset, straight to stick counts, as flown in 2010."""
    integral = [0.0, 0.0]
    sticks = (0.0, 0.0)

    def law(now: float, late: tuple[float, float] | None) -> tuple[float, float]:
        nonlocal sticks
        if late is not None:
            for i in range(2):
                integral[i] = max(-3.0, min(3.0, integral[i] - late[i] / RATE))
            out = [max(-40.0, min(40.0, round(-kp * late[i] + ki * integral[i]))) for i in range(2)]
            sticks = (out[0], out[1])
        return sticks

    return law


@pytest.mark.parametrize("wind", [WindClass.NONE, WindClass.INDOOR, WindClass.LIGHT])
def test_the_2010_law_is_lost_at_every_gain(wind: WindClass) -> None:
    rng = random.Random(f"gains {wind}")
    kp = math.exp(rng.uniform(math.log(2.0), math.log(80.0)))
    ki = rng.uniform(0.0, 0.6) * kp
    assert is_lost(pi_of_2010(kp, ki), seed=1, wind=wind, duration=60.0), f"it flew with {kp:.1f} and {ki:.1f} count/m"


def test_the_2010_law_at_a_whisper_is_lost_in_the_first_wind() -> None:
    rng = random.Random("whisper 0")
    kp = math.exp(rng.uniform(math.log(0.2), math.log(2.0)))
    ki = rng.uniform(0.0, 0.6) * kp
    assert is_lost(pi_of_2010(kp, ki), seed=0, wind=WindClass.LIGHT, duration=120.0)
