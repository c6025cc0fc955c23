"""A moving deck, and a tilted one, under the legs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mksim.config import FlightConfig, SensorConfig, WindClass
from mksim.physics.deck import MovingDeck, TiltedDeck
from mksim.physics.truth import Truth
from mksim.physics.world import DT, MOTORS_OFF, StartState, World

STILL_AIR = FlightConfig(wind=WindClass.NONE, sensors=SensorConfig.ideal())


def straight(now: float) -> np.ndarray:
    return np.array([0.5 * now, 0.0, 0.4])


def landed(ground, seconds: float, **start: float) -> Truth:
    """The truth of an aircraft that stood so long."""
    world = World(STILL_AIR, seed=1, start=StartState(**start), ground=ground)
    for _ in range(round(seconds / DT)):
        world.step(MOTORS_OFF)
    assert world.truth.on_ground
    assert not world.truth.crashed
    return world.truth


def test_an_aircraft_on_the_deck_rides_along_and_one_beside_it_stays() -> None:
    truth = landed(MovingDeck(straight, radius=0.6), 6.0)
    assert truth.position_enu == pytest.approx([3.0, 0.0, 0.5], abs=0.05)
    assert truth.velocity_enu == pytest.approx([0.5, 0.0, 0.0], abs=1e-6)
    beside = landed(MovingDeck(straight, radius=0.6), 2.0, north=2.0)
    assert beside.position_enu == pytest.approx([0.0, 2.0, 0.1], abs=1e-9)


@pytest.mark.parametrize("tilt_deg", [4.0, 12.0])
@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 200.0])
def test_an_aircraft_on_a_tilted_deck_stands_as_the_deck_slopes(tilt_deg: float, yaw_deg: float) -> None:
    """The deck slopes down towards the east: who faces east has the nose low, who faces north the right side."""
    deck = TiltedDeck((0.0, 0.0, 0.2), tilt=math.radians(tilt_deg), heading=0.0, radius=0.6)
    yaw, slope = math.radians(yaw_deg), math.tan(math.radians(tilt_deg))
    truth = landed(deck, 2.0, yaw=yaw)
    assert truth.pitch == pytest.approx(math.atan(slope * math.cos(yaw)), abs=2e-3)
    assert truth.roll == pytest.approx(math.atan(slope * math.sin(yaw)), abs=2e-3)
    assert truth.position_enu == pytest.approx([0.0, 0.0, 0.3], abs=1e-3)
    assert deck.at(0.5, 0.0, 0.0)[0] < deck.at(-0.5, 0.0, 0.0)[0]
    assert deck.at(0.7, 0.0, 0.0) == (0.0, 0.0, 0.0, 0.0)
