"""The world as a whole: signs, faults, battery, the FlightCtrl's view."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.telemetry.sim_faults import FAULTS
from mksim.config import FlightConfig, SensorConfig, WindClass
from mksim.physics.attitude_loop import EASY, AttitudeGains
from mksim.physics.world import DT, MOTORS_OFF, StartState, StickInput, World

HOVER = StickInput(0.0, 0.0, 0.0, 125.0, motors_running=True)
QUIET = FlightConfig(wind=WindClass.NONE, sensors=SensorConfig.ideal())


def run(world: World, seconds: float, sticks: StickInput = HOVER) -> World:
    for _ in range(round(seconds / DT)):
        world.step(sticks)
    return world


@pytest.mark.parametrize(
    ("field", "axis", "sign"), [("pitch", 1, 1.0), ("roll", 0, -1.0)], ids=["nose down north", "left down west"]
)
def test_firmware_signs_move_the_aircraft(field: str, axis: int, sign: float) -> None:
    """Nose north: pitch + is nose down and flies north; roll + is LEFT side down and flies west."""
    sticks = {"pitch": 0.0, "roll": 0.0, field: 20.0}
    world = World(QUIET, seed=1, start=StartState(height=10.0))
    run(world, 1.5, StickInput(**sticks, yaw=0.0, gas=125.0, motors_running=True))
    velocity = world.truth.velocity_enu
    assert sign * velocity[axis] > 1.0
    assert abs(velocity[1 - axis]) < 0.05
    assert world.truth.pitch > 0.1 if field == "pitch" else world.truth.roll < -0.1


def test_yawing_while_tilted_keeps_the_boards_angles_right() -> None:
    world = World(QUIET, seed=1, start=StartState(height=30.0))
    world.set_attitude_gains(AttitudeGains.from_parameters(**EASY, ta=1e9))
    run(world, 1.5, StickInput(15.0, 0.0, 0.0, 125.0, motors_running=True))
    run(world, 1.5, StickInput(15.0, 0.0, 80.0, 125.0, motors_running=True))
    assert abs(math.remainder(world.truth.yaw - math.pi / 2.0, 2.0 * math.pi)) > 0.8
    assert math.degrees(world.sensors.fc_angle_pitch - world.truth.pitch) == pytest.approx(0.0, abs=0.6)
    assert math.degrees(world.sensors.fc_angle_roll - world.truth.roll) == pytest.approx(0.0, abs=0.6)


def test_motors_off_in_flight_is_a_crash_and_stays_one() -> None:
    world = run(World(QUIET, seed=1, start=StartState(height=10.0)), 3.0, MOTORS_OFF)
    assert "hit the ground" in world.truth.crash_reason
    run(world, 1.0, StickInput(0.0, 0.0, 0.0, 200.0, motors_running=True))
    assert (world.truth.crashed, world.truth.on_ground) == (True, True)
    assert world.sensors.motor_setpoints == [0] * 12


def test_a_weak_motor_drops_the_nose_and_the_loop_catches_it_and_a_dead_one_is_a_crash() -> None:
    world = World(QUIET, seed=1, start=StartState(height=10.0))
    run(world, 1.0)
    world.faults.start("motor_weak", motor=1, share=0.8)
    run(world, 0.5)
    assert math.degrees(world.truth.pitch) > 1.0
    run(world, 2.5)
    assert math.degrees(world.truth.tilt) < 30.0
    world.faults.start("motor_weak", motor=1, share=0.0)
    run(world, 5.0)
    assert world.truth.crashed


def test_a_gust_pushes_is_replaced_by_another_and_passes() -> None:
    world = World(QUIET, seed=1, start=StartState(height=10.0))
    world.faults.start("wind_gust", speed=5.0, from_deg=270.0, duration=4.0)
    run(world, 1.0)
    world.faults.start("gps_lost")
    run(world, 1.0)
    assert world.truth.wind_enu[0] == pytest.approx(5.0, rel=0.02), "another fault must not restart the gust"
    assert world.truth.velocity_enu[0] > 0.5
    world.faults.start("wind_gust", speed=3.0, from_deg=180.0, duration=2.0)
    run(world, 1.0)
    assert world.truth.wind_enu == pytest.approx([0.0, 3.0, 0.0], abs=0.1)
    run(world, 1.2)
    assert world.truth.wind_enu == pytest.approx([0.0, 0.0, 0.0])
    assert not world.faults.is_active("wind_gust")


def test_battery_drop_lowers_the_reading_and_below_low_the_thrust() -> None:
    world = run(World(QUIET, seed=1, start=StartState(height=20.0)), 1.0)
    before, height = world.sensors.battery_voltage, world.truth.position_enu[2]
    setpoint = world.sensors.motor_setpoints[0]
    world.faults.start("battery_drop", volts=1.5)
    run(world, 1.0)
    assert before - world.sensors.battery_voltage == pytest.approx(1.5, abs=0.1)
    assert world.truth.position_enu[2] == pytest.approx(height, abs=0.6), "gas is compensated"
    assert world.sensors.motor_setpoints[0] == pytest.approx(setpoint * before / (before - 1.5), abs=2)
    world.faults.start("battery_drop", volts=5.5)
    run(world, 2.0)
    assert world.truth.velocity_enu[2] < -0.5


STICKS = st.floats(-127, 127)


@given(
    seed=st.integers(0, 10_000),
    height=st.sampled_from([0.0, 0.05, 1.0, 30.0]),
    moves=st.lists(
        st.tuples(STICKS, STICKS, STICKS, st.floats(0, 254), st.booleans(), st.booleans()), min_size=1, max_size=8
    ),
    faults=st.lists(st.sampled_from(sorted(FAULTS)), max_size=4),
)
def test_nothing_breaks_the_numbers(seed, height, moves, faults) -> None:
    """Whatever the sticks do and whatever fails: finite state, a proper rotation, never under the ground."""
    world = World(FlightConfig(wind=WindClass.MODERATE), seed=seed, start=StartState(height=height))
    for name in faults:
        world.faults.start(name)
    for move in moves:
        for _ in range(80):
            world.step(StickInput(*move))
        truth, sensors = world.truth, world.sensors
        assert np.isfinite([*truth.position_enu, *truth.velocity_enu, *truth.rates, truth.tilt]).all()
        assert np.isfinite([sensors.fc_angle_pitch, sensors.fc_angle_roll, sensors.heading_deg, sensors.acc_z]).all()
        assert truth.enu_from_flu @ truth.enu_from_flu.T == pytest.approx(np.eye(3), abs=1e-9)
        assert np.linalg.det(truth.enu_from_flu) == pytest.approx(1.0)
        assert np.cos(truth.tilt) == pytest.approx(truth.enu_from_flu[2, 2], abs=1e-9)
        assert truth.position_enu[2] >= 0.1 - 0.02
        assert all(0 <= count <= 254 for count in sensors.motor_setpoints)
        assert 0.0 <= sensors.heading_deg < 360.0
