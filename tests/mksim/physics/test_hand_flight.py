"""The pilot flies by his sticks alone: arm, circle, land, stop."""

from __future__ import annotations

import numpy as np
import pytest

from mksim.config import BatteryConfig, FlightConfig, WindClass
from mksim.physics.attitude_loop import FAST, AttitudeGains
from mksim.physics.hand_flight import CircleFlight, HandFlight, HandPhase
from mksim.physics.world import StartState, World

from .steering import RcBoard


def board_of(program: HandFlight, *, wind: WindClass = WindClass.LIGHT, seed: int = 1, **config: object) -> RcBoard:
    world = World(FlightConfig(wind=wind, **config), seed=seed)  # type: ignore[arg-type]
    world.pilot.program = program
    return RcBoard(world)


def test_a_low_battery_ends_the_flight_on_the_ground() -> None:
    board = board_of(CircleFlight(), battery=BatteryConfig(charge=0.10, capacity_mah=2000.0))
    before = board.world.sensors.battery_voltage
    board.run(75.0)
    assert board.world.pilot.program.phase is HandPhase.DONE  # type: ignore[union-attr]
    assert not board.armed
    assert board.world.truth.on_ground
    assert not board.world.truth.crashed
    assert board.world.sensors.battery_used_mah > 50.0
    assert board.world.sensors.battery_voltage < before


def test_lands_when_told() -> None:
    program = HandFlight(height=1.0)
    board = board_of(program, wind=WindClass.INDOOR)
    board.run(14.0)
    assert program.phase is HandPhase.FLY
    program.land()
    board.run(10.0)
    assert program.phase is HandPhase.DONE
    assert not board.armed
    assert np.hypot(*board.world.truth.position_enu[:2]) < 1.0


def test_repeats_the_gesture_until_the_motors_run() -> None:
    program = HandFlight()
    board = board_of(program)
    board.deaf_until = 9.0
    board.run(9.0)
    assert not board.armed
    assert program.phase is HandPhase.ARM
    board.run(5.0)
    assert board.armed
    assert program.phase is HandPhase.CLIMB


@pytest.mark.parametrize("wind", [WindClass.NONE, WindClass.MODERATE])
def test_flies_other_parameter_sets_too(wind: WindClass) -> None:
    world = World(FlightConfig(wind=wind), seed=4, start=StartState(height=2.0))
    world.set_attitude_gains(AttitudeGains.from_parameters(**FAST, stick_filter=False))
    world.pilot.program = HandFlight(height=2.0, flying=True)
    world.pilot.gas = 20
    board = RcBoard(world)
    board.armed = True
    board.run(20.0)
    assert np.hypot(*world.truth.position_enu[:2]) < 1.5
    assert world.truth.position_enu[2] == pytest.approx(2.1, abs=0.3)
