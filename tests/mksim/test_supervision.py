"""The pilot and a machine share the aircraft."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mksim.config import FlightConfig, WindClass
from mksim.physics.hand_flight import HandPhase
from mksim.physics.world import StickInput, World
from mksim.supervision import CEILING_GAS, Supervision

from .physics.steering import RcBoard


class SharedBoard(RcBoard):
    """A FlightCtrl on which a machine may be connected: it adds to the sticks and takes the smaller gas (stock law)."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.external: StickInput | None = None

    def sticks(self) -> StickInput:
        mine = super().sticks()
        if self.external is None:
            return mine
        return StickInput(
            mine.pitch + self.external.pitch,
            mine.roll + self.external.roll,
            mine.yaw + self.external.yaw,
            min(mine.gas, self.external.gas),
            motors_running=self.armed,
            height_control=self.external.height_control,
        )


HOLD = StickInput(0.0, 0.0, 0.0, 125.0, motors_running=True, height_control=True)


def test_hovers_hands_over_and_takes_back() -> None:
    world = World(FlightConfig(wind=WindClass.INDOOR), seed=2)
    board = SharedBoard(world)
    program = world.pilot.program = Supervision(lambda: board.external is not None)
    board.run(15.0)
    assert program.flight.phase is HandPhase.FLY
    board.external = HOLD
    board.run(2.0)
    assert program.flight is None
    assert (world.pilot.pitch, world.pilot.roll, world.pilot.gas) == (0, 0, CEILING_GAS)
    board.external = None
    board.run(0.6)
    assert world.pilot.gas == CEILING_GAS, "nobody reacts in no time"
    board.run(6.0)
    assert program.flight is not None
    assert program.take_overs == 1
    assert math.degrees(world.truth.tilt) < 10.0
    assert np.linalg.norm(world.truth.velocity_enu) < 0.5
    assert not world.truth.crashed


def test_a_machine_takes_off_and_lands_and_the_pilot_stops_the_motors() -> None:
    world = World(FlightConfig(wind=WindClass.NONE), seed=2)
    board = SharedBoard(world)
    program = world.pilot.program = Supervision(lambda: board.external is not None, take_off=False)
    board.run(3.0)
    assert (world.pilot.gas, board.armed) == (-127, False)
    board.armed = True
    board.external = replace(HOLD, gas=40.0, height_control=False)
    board.run(2.0)
    assert world.pilot.gas == CEILING_GAS
    assert world.truth.on_ground, "the machine's gas is the smaller"
    board.external = replace(HOLD, gas=145.0)
    board.run(4.0)
    assert world.truth.airborne
    board.external = replace(HOLD, gas=100.0)
    board.run(8.0)
    assert world.truth.on_ground
    assert not world.truth.crashed
    assert world.pilot.gas == -127, "down for good: the gas goes down"
    board.external = None
    board.run(6.0)
    assert not board.armed
    assert world.truth.on_ground
    board.armed, board.external = True, HOLD
    board.run(0.1)
    assert program.take_overs == 1, "he is done; the next flight is another program"
