"""The pilot flies every generation of the boards over the physics: gestures, gas law, parameter set."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS
from mksim.config import FlightConfig, WindClass
from mksim.physics.hand_flight import CircleFlight, HandPhase
from mksim.physics.world import World


def airborne(word: str) -> tuple[World, FlightCtrl]:
    world = World(FlightConfig(wind=WindClass.LIGHT), seed=1)
    world.pilot.program = CircleFlight()
    board = FlightCtrl(FC_GENERATIONS[word], world, seed=1)
    board.advance(18.0)
    return world, board


@pytest.mark.parametrize("word", list(FC_GENERATIONS))
def test_circle_is_flown_on_every_generation(word: str) -> None:
    world, board = airborne(word)
    program = world.pilot.program
    assert program.phase is HandPhase.FLY
    for until in np.arange(18.5, 25.0, 0.5):
        board.advance(float(until))
        assert world.truth.airborne
        assert math.degrees(world.truth.tilt) < 15.0
        assert np.hypot(world.truth.position_enu[0] + 1.5, world.truth.position_enu[1]) < 2.6
        assert world.truth.position_enu[2] == pytest.approx(2.1, abs=0.3)
    program.land()
    board.advance(39.0)
    assert (program.phase, board.core.running) == (HandPhase.DONE, False)
    assert (world.truth.on_ground, world.truth.crashed) == (True, False)
