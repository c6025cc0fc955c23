"""Gas as a climb-rate stick."""

from __future__ import annotations

import pytest

from mksim.config import FlightConfig, SensorConfig, WindClass
from mksim.physics.world import CLIMB_PER_COUNT, DEAD_BAND, DT, MAX_CLIMB, HeightControl, StartState, StickInput, World


def fly(gas: float, seconds: float, *, on: bool = True, noise: bool = False) -> World:
    sensors = SensorConfig() if noise else SensorConfig.ideal()
    world = World(FlightConfig(wind=WindClass.NONE, sensors=sensors), seed=1, start=StartState(height=20.0))
    for _ in range(round(seconds / DT)):
        world.step(StickInput(0.0, 0.0, 0.0, gas, motors_running=True, height_control=on))
    return world


@pytest.mark.parametrize("gas", [125.0, 125.0 + DEAD_BAND, 125.0 - DEAD_BAND])
def test_around_hover_it_holds_the_height(gas: float) -> None:
    assert fly(gas, 10.0).truth.position_enu[2] == pytest.approx(20.1, abs=0.1)
    assert fly(gas, 10.0, noise=True).truth.position_enu[2] == pytest.approx(20.1, abs=0.8)


@pytest.mark.parametrize("offset", [40.0, -40.0])
def test_beyond_it_climbs_by_the_count(offset: float) -> None:
    expected = CLIMB_PER_COUNT * (abs(offset) - DEAD_BAND) * (1 if offset > 0 else -1)
    assert fly(125.0 + offset, 4.0).truth.velocity_enu[2] == pytest.approx(expected, rel=0.15)


def test_the_same_gas_without_it_is_thrust() -> None:
    assert fly(165.0, 2.0, on=False).truth.velocity_enu[2] > 2.0 * fly(165.0, 2.0).truth.velocity_enu[2]


def test_climb_is_limited_and_gas_stays_where_attitude_has_authority() -> None:
    assert fly(254.0, 5.0).truth.velocity_enu[2] == pytest.approx(MAX_CLIMB, rel=0.1)
    control = HeightControl(125.0)
    assert control.update(0.0, 0.0, 5.0, DT) == pytest.approx(0.6 * 125.0)


def test_switching_it_off_and_on_takes_the_height_anew() -> None:
    control = HeightControl(125.0)
    control.update(125.0, 10.0, 0.0, DT)
    assert control.is_on
    control.switch_off()
    assert not control.is_on
    assert control.update(125.0, 3.0, 0.0, DT) == pytest.approx(125.0)
