"""Whole counts of gas, and what the voltage does to them."""

from __future__ import annotations

import numpy as np
import pytest

from mksim.config import AirframeConfig
from mksim.physics.airframe import GRAVITY
from mksim.physics.motors import GasChain, Motors

CONFIG = AirframeConfig()
DT = 2.048e-3
CELLS = 4
HOVER_V = 12.8
EXACT = GasChain(least=0, most=254)


def settled(
    gas: float, x: float = 0.0, y: float = 0.0, z: float = 0.0, *, v: float = HOVER_V, front: float = 1.0, **airframe
) -> Motors:
    """Motors after two seconds of gas, torques and voltage; the front one with a share of its thrust."""
    motors = Motors(AirframeConfig(**airframe), CELLS)
    motors.health[0] = front
    for _ in range(1000):
        motors.update(gas, x, y, z, v, EXACT, DT)
    return motors


def test_at_14_8_v_one_count_in_seven_is_dead_and_the_others_are_1_85_percent_of_thrust() -> None:
    thrusts = np.array([settled(gas, v=14.8).thrust for gas in range(120, 135)])
    steps = thrusts[1:] / thrusts[:-1] - 1.0
    assert (steps == 0.0).sum() == 2
    assert steps[steps != 0.0] == pytest.approx(0.0185, abs=0.0015)


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


@pytest.mark.parametrize(("reference", "setpoint"), [(12.8, 108), (9.6, 81), (0.0, 126)])
def test_the_reference_voltage_comes_from_the_set(reference: float, setpoint: int) -> None:
    assert int(GasChain(reference=reference).setpoint(127.0, 14.8)) == setpoint
