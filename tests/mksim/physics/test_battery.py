"""Discharge curve, sag, LOWBAT."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mksim.config import BatteryConfig
from mksim.physics.battery import OPEN_CIRCUIT_V, SimulatedBattery, open_circuit_voltage


@given(low=st.floats(-0.5, 1.5), high=st.floats(-0.5, 1.5))
def test_voltage_rises_with_charge(low: float, high: float) -> None:
    if low > high:
        low, high = high, low
    assert 3.0 <= open_circuit_voltage(low) <= open_circuit_voltage(high) <= 4.2


def test_voltage_at_the_knots() -> None:
    charges, voltages = zip(*OPEN_CIRCUIT_V, strict=True)
    assert [open_circuit_voltage(charge) for charge in charges] == pytest.approx(voltages)


def test_load_sags_the_voltage_at_once() -> None:
    battery = SimulatedBattery(BatteryConfig())
    battery.update(0.0, 0.02)
    idle = battery.voltage
    battery.update(1.0, 0.02)
    assert battery.current == pytest.approx(12.6)
    assert idle - battery.voltage == pytest.approx(12.0 * 4 * 0.008, rel=0.01)


def test_hover_lasts_as_long_as_the_capacity_says() -> None:
    battery = SimulatedBattery(BatteryConfig())
    seconds = 0
    while not battery.is_low and seconds < 3600:
        battery.update(1.0, 1.0)
        seconds += 1
    nominal = 3300.0 / 12600.0 * 3600.0
    assert 0.85 * nominal < seconds < nominal
    assert battery.used_mah == pytest.approx(12600.0 * seconds / 3600.0)
    assert battery.voltage < 4 * 3.3


def test_an_empty_pack_stays_finite() -> None:
    battery = SimulatedBattery(BatteryConfig(charge=0.05))
    for _ in range(1000):
        battery.update(2.0, 1.0)
    assert battery.charge == 0.0
    assert 0.5 <= battery.voltage < 4 * 3.0


def test_a_fault_takes_volts_off() -> None:
    battery = SimulatedBattery(BatteryConfig())
    battery.update(1.0, 0.02)
    before = battery.voltage
    battery.drop = 3.6
    battery.update(1.0, 0.02)
    assert before - battery.voltage == pytest.approx(3.6, abs=0.01)
    assert battery.is_low
