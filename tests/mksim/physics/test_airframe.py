"""Rigid body, ground and crash: energy, signs, contact."""

from __future__ import annotations

import math
import operator

import pytest

from mkdaemon.frames import rotation_from_quaternion
from mksim.config import AirframeConfig
from mksim.physics.airframe import GRAVITY, Airframe, FlatGround

DT = 2.048e-3
STILL = (0.0, 0.0, 0.0)
NO_TORQUE = (0.0, 0.0, 0.0)
CONFIG = AirframeConfig()
WEIGHT = CONFIG.mass * GRAVITY


def airframe_at(height: float, *, yaw: float = 0.0, config: AirframeConfig = CONFIG) -> Airframe:
    airframe = Airframe(config, FlatGround())
    airframe.place(0.0, 0.0, height, yaw)
    return airframe


def run(airframe: Airframe, seconds: float, thrust: float = 0.0, torque=NO_TORQUE, wind=STILL) -> None:
    for k in range(round(seconds / DT)):
        airframe.step(thrust, torque, wind, k * DT, DT)


def test_free_fall_gains_no_energy_and_ends_in_a_crash() -> None:
    airframe = airframe_at(30.0)
    energy = math.inf
    while not airframe.on_ground:
        airframe.step(0.0, NO_TORQUE, STILL, 0.0, DT)
        now = 0.5 * airframe.v_up**2 + GRAVITY * airframe.up
        assert now <= energy
        energy = now
    assert airframe.crashed
    assert "hit the ground at" in airframe.crash_reason


@pytest.mark.parametrize(
    ("torque", "reads"), [((1e-3, 0.0, 0.0), "roll"), ((0.0, 1e-3, 0.0), "pitch"), ((0.0, 0.0, 1e-3), "yaw")]
)
def test_torque_turns_its_own_axis_and_the_positive_way(torque: tuple[float, float, float], reads: str) -> None:
    airframe = airframe_at(50.0)
    run(airframe, 0.5, thrust=WEIGHT, torque=torque)
    inertia = {"roll": CONFIG.inertia_roll, "pitch": CONFIG.inertia_pitch, "yaw": CONFIG.inertia_yaw}[reads]
    for axis in ("roll", "pitch", "yaw"):
        expected = 0.5 * 1e-3 / inertia * 0.25 if axis == reads else 0.0
        assert getattr(airframe, axis) == pytest.approx(expected, rel=0.02, abs=1e-9)


def test_tumbling_keeps_rotation_and_angular_momentum() -> None:
    airframe = airframe_at(1000.0)
    run(airframe, 0.1, torque=(0.5, 0.3, 0.2))
    inertia = (CONFIG.inertia_roll, CONFIG.inertia_pitch, CONFIG.inertia_yaw)

    def momentum() -> float:
        return math.hypot(*map(operator.mul, inertia, (airframe.rate_x, airframe.rate_y, airframe.rate_z)))

    before = momentum()
    run(airframe, 3.0)
    assert momentum() == pytest.approx(before, rel=0.02)
    assert math.hypot(*airframe.quaternion) == pytest.approx(1.0, abs=1e-12)
    rotation = rotation_from_quaternion(airframe.quaternion)
    assert airframe.enu_from_flu == pytest.approx(rotation.ravel(), abs=1e-12)


def test_an_accelerometer_in_flight_feels_drag_not_gravity() -> None:
    """Why the attitude leaks: leaning at rest reads the tilt, flying leaned reads only the air."""
    airframe = airframe_at(500.0)
    run(airframe, 0.1, torque=(0.0, 5e-2, 0.0), thrust=WEIGHT)
    run(airframe, 0.1, torque=(0.0, -5e-2, 0.0), thrust=WEIGHT)
    assert math.degrees(airframe.pitch) > 2.0
    shown = math.degrees(-airframe.force_x / GRAVITY)
    assert abs(shown) < 0.1 * math.degrees(airframe.pitch)


def test_ground_effect_lifts_near_the_ground_only() -> None:
    def climb_after(height: float) -> float:
        airframe = airframe_at(height)
        run(airframe, 0.2, thrust=WEIGHT)
        return airframe.v_up

    assert climb_after(0.02) > climb_after(0.15) > climb_after(0.4) > 0.0
    assert climb_after(3.0) == pytest.approx(0.0, abs=1e-9)


def test_a_leaning_touch_down_is_righted() -> None:
    airframe = airframe_at(0.3)
    run(airframe, 0.1, torque=(0.0, 0.15, 0.0))
    assert math.degrees(airframe.pitch) > 3.0
    run(airframe, 2.0)
    assert airframe.on_ground
    assert not airframe.crashed
    assert abs(math.degrees(airframe.pitch)) < 0.1
    assert (airframe.rate_x, airframe.rate_y, airframe.rate_z) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


@pytest.mark.parametrize(
    ("v_up", "v_east", "reason"), [(-3.0, 0.0, "hit the ground"), (-0.5, 5.0, "sliding"), (-2.0, 0.5, "")]
)
def test_what_breaks_it(v_up: float, v_east: float, reason: str) -> None:
    airframe = airframe_at(0.01)
    airframe.v_up, airframe.v_east = v_up, v_east
    run(airframe, 0.1)
    assert airframe.crashed is bool(reason)
    assert reason in airframe.crash_reason
