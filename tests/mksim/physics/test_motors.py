"""Mixer, thrust and lag."""

from __future__ import annotations

import numpy as np
import pytest

from mksim.config import AirframeConfig
from mksim.physics.airframe import GRAVITY
from mksim.physics.motors import MAX_COUNT, MIN_COUNT, GasChain, Motors

CONFIG = AirframeConfig()
DT = 2.048e-3
CELLS = 4
HOVER_V = 12.8
EXACT = GasChain(least=0, most=254)
HOVER_GAS = 126.0
"""At the hover voltage: the mixer loses nine tenths of a count."""


def settled(
    gas: float, x: float = 0.0, y: float = 0.0, z: float = 0.0, *, v: float = HOVER_V, front: float = 1.0, **airframe
) -> Motors:
    """Motors after two seconds of gas, torques and voltage; the front one with a share of its thrust."""
    motors = Motors(AirframeConfig(**airframe), CELLS)
    motors.health[0] = front
    for _ in range(1000):
        motors.update(gas, x, y, z, v, EXACT, DT)
    return motors


@pytest.mark.parametrize("mass", [1.25, 1.75])
def test_hover_count_carries_the_mass(mass: float) -> None:
    motors = settled(HOVER_GAS, mass=mass)
    # the mixer loses nine tenths of a count, so a whole count of gas is a tenth off
    assert motors.thrust == pytest.approx(mass * GRAVITY * (125.1 / 125.0) ** 2, rel=1e-6)
    assert motors.load == pytest.approx((125.1 / 125.0) ** 3, rel=1e-6)


def test_at_14_8_v_one_count_in_seven_is_dead_and_the_others_are_1_85_percent_of_thrust() -> None:
    thrusts = np.array([settled(gas, v=14.8).thrust for gas in range(120, 135)])
    steps = thrusts[1:] / thrusts[:-1] - 1.0
    assert (steps == 0.0).sum() == 2
    assert steps[steps != 0.0] == pytest.approx(0.0185, abs=0.0015)


def test_gas_counts_are_whole_numbers() -> None:
    assert settled(126.9).thrust == settled(126.0).thrust


def test_thrust_jumps_by_one_count_where_the_measured_voltage_changes_by_a_tenth() -> None:
    by_voltage = [settled(127.0, v=tenths / 10 + 0.05).setpoints[0] for tenths in range(148, 152)]
    assert by_voltage == [108, 108, 107, 106]
    assert settled(127.0, v=14.81).setpoints[0] == settled(127.0, v=14.89).setpoints[0] == 108


def test_hover_needs_126_7_at_the_stick() -> None:
    """Between two counts: whole numbers round down, and the mixer once more; mean over the voltages of a flight."""
    needed = []
    for tenths in range(148, 164, 3):
        thrusts = {gas: settled(gas, v=tenths / 10).thrust for gas in range(122, 133)}
        below = max(gas for gas, thrust in thrusts.items() if thrust <= CONFIG.mass * GRAVITY)
        low, high = thrusts[below], thrusts[below + 1]
        needed.append(below + (CONFIG.mass * GRAVITY - low) / max(high - low, 1e-9))
    assert sum(needed) / len(needed) == pytest.approx(126.7, abs=0.4)


def test_collective_follows_in_the_motor_lag() -> None:
    motors = settled(HOVER_GAS)
    begin = motors.thrust
    for _ in range(round(CONFIG.motor_lag / DT)):
        motors.update(151.0, 0.0, 0.0, 0.0, HOVER_V, EXACT, DT)
    reached = (motors.thrust / begin) ** 0.5 * 125.0
    assert reached == pytest.approx(125.0 + 25.0 * 0.632, abs=0.5)


@pytest.mark.parametrize(("axis", "turn", "wanted"), [("x", "roll", 5.0), ("y", "pitch", -5.0), ("z", "yaw", 3.0)])
def test_torque_gives_the_acceleration_asked_for_at_hover(axis: str, turn: str, wanted: float) -> None:
    torque = getattr(settled(HOVER_GAS, **{axis: wanted}), f"torque_{axis}")
    assert torque / getattr(CONFIG, f"inertia_{turn}") == pytest.approx(wanted, rel=0.01)


def test_authority_goes_with_gas() -> None:
    half = settled(63.4, y=5.0).torque_y
    assert half == pytest.approx(0.5 * settled(HOVER_GAS, y=5.0).torque_y, rel=0.02)


def test_set_points_stay_in_range_and_limit_the_torque() -> None:
    motors = settled(HOVER_GAS, y=1000.0)
    assert motors.setpoints[0] == MIN_COUNT
    assert motors.setpoints[1] == MAX_COUNT
    assert motors.torque_y < 1000.0 * CONFIG.inertia_pitch
    assert motors.setpoints[4:] == [0] * 8


def test_compensation_lowers_set_points_not_thrust() -> None:
    strong = settled(HOVER_GAS, v=16.0)
    assert strong.setpoints[0] < settled(HOVER_GAS).setpoints[0]
    assert strong.thrust == pytest.approx(settled(HOVER_GAS).thrust, rel=0.02)


@pytest.mark.parametrize(("reference", "setpoint"), [(12.8, 108), (9.6, 81), (0.0, 126)])
def test_the_reference_voltage_comes_from_the_set(reference: float, setpoint: int) -> None:
    assert int(GasChain(reference=reference).setpoint(127.0, 14.8)) == setpoint


def test_below_the_reference_thrust_fades() -> None:
    assert settled(HOVER_GAS, v=0.9 * HOVER_V).thrust == pytest.approx(0.81 * settled(HOVER_GAS).thrust, rel=1e-6)


def test_weak_motor_loses_its_share_and_turns_the_aircraft() -> None:
    motors = settled(HOVER_GAS, front=0.8)
    assert motors.thrust == pytest.approx(0.95 * CONFIG.mass * GRAVITY, rel=2e-3)
    assert motors.torque_y > 0.0, "a weak front motor drops the nose"


def test_motors_off_run_down() -> None:
    motors = settled(HOVER_GAS)
    for _ in range(round(0.5 / DT)):
        motors.coast(DT)
    assert motors.thrust < 1e-3
    assert motors.setpoints == [0] * 12
    assert motors.load == 0.0
