"""Walls are solid: an aircraft that flies into one is broken, and what is left does not pass it."""

from __future__ import annotations

import pytest

from mksim.config import FlightConfig, SensorConfig, WallConfig, WindClass
from mksim.physics.solidwall import PROPELLER_RADIUS
from mksim.physics.world import DT, StartState, StickInput, World

REACH = 0.155 + PROPELLER_RADIUS
AHEAD = WallConfig(start=(1.5, -1.0), end=(1.5, 1.0), height=2.0)


def flown(height, seconds=4.0, walls=(AHEAD,), north=0.0):
    """Lean towards the east from a hover at the origin; the world, and how far east it came."""
    cfg = FlightConfig(wind=WindClass.NONE, sensors=SensorConfig.ideal(), walls=walls)
    world = World(cfg, seed=1, start=StartState(height=height, north=north, yaw=0.0))
    farthest = 0.0
    for _ in range(round(seconds / DT)):
        world.step(StickInput(20.0, 0.0, 0.0, 127.0, motors_running=True))
        farthest = max(farthest, float(world.truth.position_enu[0]))
    return world, farthest


def test_who_flies_into_a_wall_is_lost_and_does_not_pass_it():
    world, farthest = flown(1.0)
    assert world.truth.crash_reason.startswith("hit a wall at ")
    assert farthest == pytest.approx(1.5 - REACH, abs=0.02)
    assert world.truth.on_ground


HANGING = WallConfig(start=(1.5, -1.0), end=(1.5, 1.0), bottom=2.0)


@pytest.mark.parametrize(
    ("height", "north", "wall"),
    [(2.5, 0.0, AHEAD), (1.0, 1.4, AHEAD), (1.0, 0.0, HANGING)],
    ids=["over", "by", "under"],
)
def test_over_it_beside_it_and_below_one_that_hangs_is_free(height, north, wall):
    world, farthest = flown(height, 2.0, (wall,), north)
    assert not world.truth.crashed
    assert farthest > 2.0
