"""The hover throttle from a lift-off: of a simulated aircraft."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.control.estimator.liftoff import lifted_off
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.values import StickCommand
from mksim.config import AirframeConfig, FlightConfig
from mksim.physics.world import DT, StickInput, World

MODEL = AircraftModel()
BETWEEN = (80.0, 160.0)
STANDS = 0.1
"""Height of the simulated centre of gravity when the feet stand [m]."""


def rising(gas, seconds=1.4, period=0.02, first=27.0, slew=300.0):
    """Stick frames whose throttle rises to `gas` as a take-off's does [count of 254]."""
    times = [k * period for k in range(round(seconds / period))]
    return [StickCommand(at, 0.0, 0.0, 0.0, min(first + slew * at, gas)) for at in times]


def flown(frames, mass):
    """Heights of the feet that a simulated aircraft of a mass [kg] reaches with stick frames: (time, height, climb)."""
    hover = 125.0 * math.sqrt(mass / 1.25)
    world = World(FlightConfig(airframe=AirframeConfig(mass=mass, hover_count=hover)), seed=1)
    path = []
    while world.now < frames[-1].at + MODEL.uplink:
        acting = [frame.gas for frame in frames if frame.at + MODEL.uplink <= world.now]
        world.step(StickInput(0.0, 0.0, 0.0, acting[-1] if acting else 0.0, motors_running=True))
        path.append((world.now, world.truth.position_enu[2] - STANDS, world.truth.velocity_enu[2]))
    return path


@given(height=st.floats(0.07, 1.0), more=st.floats(0.01, 1.0), at=st.floats(0.6, 1.2))
def test_the_higher_an_aircraft_was_seen_the_less_throttle_carries_it(height, more, at):
    frames = rising(150.0)
    low, high = (lifted_off(frames, [(at, each)], MODEL, BETWEEN) for each in (height, height + more))
    assert BETWEEN[0] <= high.hover_gas <= low.hover_gas <= BETWEEN[1]


@pytest.mark.parametrize("mass", [1.0, 1.25, 1.5])
@pytest.mark.parametrize("share", [1.05, 1.15, 1.25])
def test_hover_throttle_and_climb_rate_of_a_simulated_aircraft_are_found(mass, share):
    hover = 125.0 * math.sqrt(mass / 1.25) + 1.7  # docs/simulator.md: whole numbers cost the FlightCtrl that much
    path = flown(rising(share * hover), mass)
    off = [each for each in path if each[1] > 0.06]
    step = round(0.067 / DT)
    images = off[: 3 * step : step]
    found = lifted_off(rising(share * hover), [(at, height) for at, height, _ in images], MODEL, BETWEEN)
    assert found.hover_gas == pytest.approx(hover, rel=0.03)
    assert found.climb == pytest.approx(images[-1][2], abs=0.15)
