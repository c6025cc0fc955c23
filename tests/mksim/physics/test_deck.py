"""A moving deck under the legs."""

from __future__ import annotations

import numpy as np
import pytest

from mksim.config import FlightConfig, SensorConfig, WindClass
from mksim.physics.deck import MovingDeck
from mksim.physics.world import DT, MOTORS_OFF, StartState, World

STILL_AIR = FlightConfig(wind=WindClass.NONE, sensors=SensorConfig.ideal())


def straight(now: float) -> np.ndarray:
    return np.array([0.5 * now, 0.0, 0.4])


def test_only_the_deck_is_high_and_moves() -> None:
    deck = MovingDeck(straight, radius=0.6)
    assert deck.at(1.0, 0.0, 2.0) == pytest.approx((0.4, 0.5, 0.0, 0.0))
    assert deck.at(1.7, 0.0, 2.0) == (0.0, 0.0, 0.0, 0.0)
    assert deck.at(1.605, 0.0, 2.0 + 5 * DT)[0] == pytest.approx(0.4), "it moves between its samples"


def test_an_aircraft_on_the_deck_rides_along() -> None:
    world = World(STILL_AIR, seed=1, ground=MovingDeck(straight, radius=0.6))
    for _ in range(round(6.0 / DT)):
        world.step(MOTORS_OFF)
    assert world.truth.on_ground
    assert not world.truth.crashed
    assert world.truth.position_enu == pytest.approx([3.0, 0.0, 0.5], abs=0.05)
    assert world.truth.velocity_enu == pytest.approx([0.5, 0.0, 0.0], abs=1e-6)


def test_an_aircraft_beside_the_deck_stays() -> None:
    world = World(STILL_AIR, seed=1, start=StartState(east=0.0, north=2.0), ground=MovingDeck(straight, radius=0.6))
    for _ in range(round(2.0 / DT)):
        world.step(MOTORS_OFF)
    assert world.truth.position_enu == pytest.approx([0.0, 2.0, 0.1], abs=1e-9)
