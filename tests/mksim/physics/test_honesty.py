"""The simulator is honest: what was lost outside in 2010 is lost in here, and what models the loop flies.

Both controllers get the same: exact positions while the target is in view, 15 a second, 250 ms late; heading and height
are held for them, so that only the horizontal law is on trial.

The gains of 2010 are drawn from 2 to 80 counts a metre. Below 0.9 the equations are stable in still air, by drag alone
and with a bandwidth of 0.15 rad/s; such a law loses the target in the first wind (second test).
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from mksim.config import FlightConfig, WindClass
from mksim.physics.attitude_loop import AttitudeGains
from mksim.physics.world import StartState, StickInput, World

G = 9.81
DELAY = 0.250
RATE = 15.0
LOST_AT = 15.0
HEIGHT = 3.0
VIEW = 0.75 * HEIGHT
"""The camera sees 74 degrees."""
Law = Callable[[float, tuple[float, float] | None], tuple[float, float]]
"""Time and a new late position (or None) to the pitch and roll sticks [count], nose towards east."""


def fly(law: Law, *, seed: int, wind: WindClass, duration: float) -> tuple[bool, list[float]]:
    """Fly a law around the origin: whether it was lost, and the distances kept."""
    world = World(FlightConfig(wind=wind), seed=seed, start=StartState(height=HEIGHT, yaw=0.0))
    hover = FlightConfig().airframe.hover_count
    pending: deque[tuple[float, tuple[float, float]]] = deque()
    next_shot = next_command = 0.0
    pitch = roll = 0.0
    distances = []
    while world.now < duration:
        now = world.now
        east, north, up = (float(x) for x in world.truth.position_enu)
        away = math.hypot(east, north)
        if away > LOST_AT or world.truth.crashed or world.truth.on_ground or math.degrees(world.truth.tilt) > 75.0:
            return True, distances
        assert up < 20.0, "height control must hold the height for the law on trial"
        if now >= next_shot:
            next_shot += 1.0 / RATE
            if away < VIEW:
                pending.append((now + DELAY, (east, north)))
        if now >= next_command:
            next_command += 0.02
            late = pending.popleft()[1] if pending and pending[0][0] <= now else None
            pitch, roll = law(now, late)
            distances.append(away)
        world.step(StickInput(pitch, roll, 0.0, hover, motors_running=True, height_control=True))
    return False, distances


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


@pytest.mark.parametrize("block", range(1))
def test_the_2010_law_is_lost_at_every_gain(block: int) -> None:
    rng = random.Random(f"gains {block}")
    for k in range(3):
        kp = math.exp(rng.uniform(math.log(2.0), math.log(80.0)))
        ki = rng.uniform(0.0, 0.6) * kp
        wind = (WindClass.NONE, WindClass.INDOOR, WindClass.LIGHT)[k]
        lost, _ = fly(pi_of_2010(kp, ki), seed=10 * block + k, wind=wind, duration=60.0)
        assert lost, f"PI with kp {kp:.1f} and ki {ki:.1f} count/m flew in {wind} wind"


@pytest.mark.parametrize("seed", range(1))
def test_the_2010_law_at_a_whisper_is_lost_in_the_first_wind(seed: int) -> None:
    rng = random.Random(f"whisper {seed}")
    kp = math.exp(rng.uniform(math.log(0.2), math.log(2.0)))
    lost, _ = fly(pi_of_2010(kp, rng.uniform(0.0, 0.6) * kp), seed=seed, wind=WindClass.LIGHT, duration=120.0)
    assert lost


class AxisModel:
    """What a plain law must know: one axis of the loop, its state estimated from late positions by a constant gain."""

    STEP = 0.01

    def __init__(self, gains: AttitudeGains, drag: float, lag: float) -> None:
        # states: position, speed, tilt, believed tilt, its integral, rate, filtered stick, disturbance
        a = np.zeros((8, 8))
        a[0, 1] = 1.0
        a[1, 1], a[1, 2], a[1, 7] = -drag, G, 1.0
        a[2, 5] = 1.0
        a[3, 5], a[3, 3], a[3, 1], a[3, 7] = 1.0, -1.0 / gains.ta, drag / G / gains.ta, -1.0 / G / gains.ta
        a[4, 3], a[4, 6] = 1.0, -1.0
        a[5, 3], a[5, 6], a[5, 4], a[5, 5] = -gains.a1 / lag, gains.a1 / lag, -gains.a2 / lag, -1.0 / lag
        a[6, 6] = -1.0 / gains.ts
        b = np.zeros(8)
        b[6] = 1.0 / gains.ts
        step = a * self.STEP
        series = np.eye(8) + step @ (np.eye(8) + step @ (np.eye(8) + step / 3.0) / 2.0)
        self.f = series
        self.b = b * self.STEP
        noise = np.diag([0.0, 0.05, 0.01, 0.01, 0.003, 0.3, 0.05, 0.2]) ** 2 * self.STEP
        covariance = np.eye(8) * 0.1
        every = round(1.0 / RATE / self.STEP)
        for _ in range(400):  # the Riccati recursion, run until it stands still
            for _ in range(every):
                covariance = self.f @ covariance @ self.f.T + noise
            gain = covariance[:, 0] / (covariance[0, 0] + 0.01**2)
            covariance = covariance - np.outer(gain, covariance[0])
        self.gain = gain
        self.x = np.zeros(8)
        self.history: deque[tuple[npt.NDArray[np.float64], float]] = deque(maxlen=round(DELAY / self.STEP))

    def advance(self, u: float) -> None:
        self.history.append((self.x, u))
        self.x = self.f @ self.x + self.b * u

    def correct(self, position: float) -> None:
        inputs = [u for _, u in self.history]
        x = self.history[0][0]
        x = x + self.gain * (position - x[0])
        self.history.clear()
        self.x = x
        for u in inputs:
            self.advance(u)


def cascade(gains: AttitudeGains) -> Law:
    """Plain PD on position and speed, tilt in between, the attitude loop inverted at the end."""
    config = FlightConfig()
    models = [AxisModel(gains, config.airframe.drag, config.loop.rate_lag) for _ in range(2)]
    sticks = [0.0, 0.0]
    rounding = [0.0, 0.0]

    def law(now: float, late: tuple[float, float] | None) -> tuple[float, float]:
        for i, model in enumerate(models):
            for _ in range(2):
                model.advance(sticks[i] * gains.rad_per_count)
            if late is not None and len(model.history) == model.history.maxlen:
                model.correct(late[i])
            p, v, t, th, z, _, _, d = (float(value) for value in model.x)
            wanted = max(-1.2, min(1.2, -1.0 * p))
            tilt = (1.6 * (wanted - v) - d + config.airframe.drag * v) / G
            rate = 4.5 * (max(-0.26, min(0.26, tilt)) - t)
            count = (th + (max(-1.2, min(1.2, rate)) + gains.a2 * z) / gains.a1) / gains.rad_per_count + rounding[i]
            sticks[i] = float(max(-60, min(60, round(count))))
            rounding[i] = max(-1.0, min(1.0, count - sticks[i]))
        return sticks[0], sticks[1]

    return law


@pytest.mark.parametrize(
    ("seed", "wind", "limit"),
    [(1, WindClass.NONE, 0.15), (2, WindClass.MODERATE, 1.5)],
)
def test_a_plain_law_that_models_the_loop_is_not_lost(seed: int, wind: WindClass, limit: float) -> None:
    lost, distances = fly(cascade(AttitudeGains.from_parameters()), seed=seed, wind=wind, duration=30.0)
    assert not lost
    assert len(distances) > 1490
    assert max(distances[len(distances) // 2 :]) < limit
