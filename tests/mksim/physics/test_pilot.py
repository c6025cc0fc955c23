"""Transmitter, eyes and reaction of the simulated pilot."""

from __future__ import annotations

import pytest

from mksim.config import FlightConfig, PilotConfig, SensorConfig, WindClass
from mksim.physics.hand_flight import HandFlight
from mksim.physics.pilot import GOOD_RC, RC_PERIOD
from mksim.physics.world import DT, StartState, StickInput, World

from .steering import RcBoard

HOVER = StickInput(0.0, 0.0, 0.0, 125.0, motors_running=True)


def world_of(*, height: float = 0.0, watches: bool = False, gate: int = 255) -> World:
    config = FlightConfig(
        wind=WindClass.NONE, sensors=SensorConfig.ideal(), pilot=PilotConfig(watches=watches, gate=gate)
    )
    return World(config, seed=1, start=StartState(height=height))


def run(world: World, seconds: float, sticks: StickInput = HOVER) -> None:
    for _ in range(round(seconds / DT)):
        world.step(sticks)


def test_takes_over_after_his_reaction() -> None:
    world = world_of(height=5.0)
    run(world, 1.0)
    world.pilot.take_over(world.now)
    world.pilot.take_over(world.now + 0.3)
    run(world, 0.65)
    assert world.pilot.took_over_at is None
    assert world.pilot.gate == 255
    run(world, 0.1)
    assert world.pilot.took_over_at == pytest.approx(1.7, abs=RC_PERIOD + DT)
    assert world.pilot.gate == 0
    assert isinstance(world.pilot.program, HandFlight)
    world.pilot.release_control()
    assert world.pilot.gate == 255
    assert world.pilot.program is None


@pytest.mark.parametrize("sticks", [(45.0, 0.0), (0.0, -45.0)])
def test_watches_and_saves_the_aircraft(sticks: tuple[float, float]) -> None:
    """External control holds a tilt for ever; the pilot sees it, closes the gate, stops the aircraft and lands."""
    world = world_of(height=12.0, watches=True)
    board = RcBoard(world)
    board.armed = True
    while world.now < 60.0 and not (world.truth.on_ground and not board.armed):
        took_over = world.pilot.took_over_at is not None
        flown = board.sticks()
        external = StickInput(sticks[0], sticks[1], 0.0, 127.0, motors_running=True)
        world.step(flown if took_over else external)
    assert world.pilot.took_over_at is not None
    assert world.pilot.took_over_at < 6.0
    assert world.truth.on_ground
    assert not world.truth.crashed, world.truth.crash_reason


def test_sees_no_trouble_in_a_hover() -> None:
    world = world_of(height=5.0, watches=True)
    run(world, 5.0)
    assert world.pilot.took_over_at is None
    assert not world.truth.crashed


def test_faults_reach_the_transmitter() -> None:
    world = world_of(height=5.0)
    world.faults.start("rc_lost")
    world.faults.start("gate_closed", duration=0.5)
    shown = []
    for seconds in (0.1, 0.6, 0.1):
        run(world, seconds)
        shown.append((world.pilot.rc_quality, world.pilot.gate))
        if len(shown) == 2:
            world.faults.stop("rc_lost")
    assert shown == [(0, 0), (0, 255), (GOOD_RC, 255)]
