"""Mixer, thrust and lag."""

from __future__ import annotations

import pytest

from mkdaemon.config.sim_flight import AirframeConfig
from mkdaemon.sim.physics.airframe import GRAVITY
from mkdaemon.sim.physics.motors import COMPENSATION_V, MAX_COUNT, MIN_COUNT, Motors

CONFIG = AirframeConfig()
DT = 2.048e-3


def settled(gas: float, x: float = 0.0, y: float = 0.0, z: float = 0.0, *, comp: float = 1.0, v: float = 1.0) -> Motors:
    motors = Motors(CONFIG)
    for _ in range(1000):
        motors.update(gas, x, y, z, comp, v, DT)
    return motors


@pytest.mark.parametrize("mass", [1.25, 1.75])
def test_hover_count_carries_the_mass(mass: float) -> None:
    motors = Motors(AirframeConfig(mass=mass))
    for _ in range(1000):
        motors.update(CONFIG.hover_count, 0.0, 0.0, 0.0, 1.0, 1.0, DT)
    assert motors.thrust == pytest.approx(mass * GRAVITY, rel=1e-6)
    assert motors.load == pytest.approx(1.0, rel=1e-6)


def test_one_count_is_about_1_6_percent_of_thrust() -> None:
    assert settled(126.0).thrust / settled(125.0).thrust == pytest.approx(1.016, abs=0.0005)


def test_collective_follows_in_the_motor_lag() -> None:
    motors = settled(125.0)
    begin = motors.thrust
    for _ in range(round(CONFIG.motor_lag / DT)):
        motors.update(150.0, 0.0, 0.0, 0.0, 1.0, 1.0, DT)
    reached = (motors.thrust / begin) ** 0.5 * 125.0
    assert reached == pytest.approx(125.0 + 25.0 * 0.632, abs=0.5)


def test_signs_are_those_seen_on_the_motors() -> None:
    """Nose down lowers the front; right side down raises the left (4); nose left raises 1 and 2."""
    front, rear, right, left = settled(125.0, y=10.0).setpoints[:4]
    assert front < 125 < rear
    assert right == left == 125
    front, rear, right, left = settled(125.0, x=10.0).setpoints[:4]
    assert right < 125 < left
    assert front == rear == 125
    front, rear, right, left = settled(125.0, z=5.0).setpoints[:4]
    assert front == rear > 125 > right == left


def test_torque_gives_the_acceleration_asked_for_at_hover() -> None:
    assert settled(125.0, x=5.0).torque_x / CONFIG.inertia_roll == pytest.approx(5.0, rel=0.01)
    assert settled(125.0, y=-5.0).torque_y / CONFIG.inertia_pitch == pytest.approx(-5.0, rel=0.01)
    assert settled(125.0, z=3.0).torque_z / CONFIG.inertia_yaw == pytest.approx(3.0, rel=0.01)


def test_authority_goes_with_gas() -> None:
    half = settled(62.5, y=5.0).torque_y
    assert half == pytest.approx(0.5 * settled(125.0, y=5.0).torque_y, rel=0.02)


def test_set_points_stay_in_range_and_limit_the_torque() -> None:
    motors = settled(125.0, y=1000.0)
    assert motors.setpoints[0] == MIN_COUNT
    assert motors.setpoints[1] == MAX_COUNT
    assert motors.torque_y < 1000.0 * CONFIG.inertia_pitch
    assert motors.setpoints[4:] == [0] * 8


def test_compensation_raises_counts_not_thrust() -> None:
    weak = settled(125.0, comp=1.15)
    assert weak.thrust == pytest.approx(settled(125.0).thrust)
    assert weak.setpoints[0] == int(125 * 1.15)
    assert settled(250.0, comp=1.15).thrust < settled(250.0).thrust


@pytest.mark.parametrize(("gas", "setpoint"), [(27.0, 22), (77.0, 65), (127.0, 108)])
def test_set_points_at_the_bench_voltage(gas: float, setpoint: int) -> None:
    assert settled(gas, comp=COMPENSATION_V / 14.8).setpoints[:4] == [setpoint] * 4


def test_below_the_low_voltage_thrust_fades() -> None:
    assert settled(125.0, comp=1.27, v=0.9).thrust == pytest.approx(0.81 * settled(125.0).thrust, rel=1e-6)


def test_weak_motor_loses_its_share_and_turns_the_aircraft() -> None:
    motors = Motors(CONFIG)
    motors.health = [0.8, 1.0, 1.0, 1.0]
    for _ in range(1000):
        motors.update(125.0, 0.0, 0.0, 0.0, 1.0, 1.0, DT)
    assert motors.thrust == pytest.approx(0.95 * CONFIG.mass * GRAVITY)
    assert motors.torque_y > 0.0, "a weak front motor drops the nose"


def test_motors_off_run_down() -> None:
    motors = settled(125.0)
    for _ in range(round(0.5 / DT)):
        motors.coast(DT)
    assert motors.thrust < 1e-3
    assert motors.setpoints == [0] * 12
    assert motors.load == 0.0
