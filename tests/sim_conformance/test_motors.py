"""What reaches the motors: set points against throttle, and the signs of every axis (docs/firmware-notes, 6)."""

from __future__ import annotations

import pytest

from mkdaemon.protocol.framing import encode_frame
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS
from mksim.config import BatteryConfig, FlightConfig, GasLaw, SensorConfig, WindClass
from mksim.physics.world import World

BENCH_SUPPLY = BatteryConfig(charge=0.21, cell_resistance=0.0, capacity_mah=60000.0)
"""14.8 V, as a bench supply gives it under any load."""


class Stand:
    """An aircraft held by its owner: motors on, driven by `b` frames of the fork."""

    def __init__(self):
        self.world = World(
            FlightConfig(sensors=SensorConfig.ideal(), wind=WindClass.NONE, battery=BENCH_SUPPLY), seed=1
        )
        self.board = FlightCtrl(
            FC_GENERATIONS["2.12a"],
            self.world,
            seed=1,
            gas_law=GasLaw.FORK,
            gate_parameter=255,
            calibrated=True,
        )
        self.board.advance(0.5)
        self.board.core.start()

    def drive(self, *, pitch=0, roll=0, yaw=0, gas=-50, seconds=0.5):
        """Hold sticks and return the set points of motors 1 to 4."""
        end = self.board.now + seconds
        while self.board.now < end:
            sticks = bytes(value & 0xFF for value in (pitch, roll, yaw, gas))
            self.board.receive(encode_frame(1, "b", sticks + bytes([1, 1, 0])), self.board.now)
            self.board.advance(self.board.now + 0.05)
        return list(self.world.sensors.motor_setpoints[:4])


MEASURED = [(-127, 17), (-100, 22), (-50, 65), (0, 108)]
"""Throttle of `b` and set point, at the 14.8 V of the measurement."""


@pytest.mark.parametrize(("gas", "setpoint"), MEASURED)
def test_set_points_follow_the_throttle_as_measured(gas, setpoint):
    assert Stand().drive(gas=gas) == [setpoint] * 4


SIGNS = [
    # axis, motors that rise, motors that fall; 1 front, 2 rear, 3 right, 4 left
    ("pitch", [2], [1]),
    ("roll", [3], [4]),
    ("yaw", [1, 2], [3, 4]),
]


@pytest.mark.parametrize(("axis", "rise", "fall"), SIGNS)
@pytest.mark.parametrize("sign", [1, -1])
def test_signs_seen_on_the_motors(axis, rise, fall, sign):
    stand = Stand()
    level = stand.drive()
    turned = stand.drive(**{axis: 40 * sign}, seconds=0.1)
    change = [sign * (after - before) for before, after in zip(level, turned, strict=True)]
    assert all(change[motor - 1] > 0 for motor in rise)
    assert all(change[motor - 1] < 0 for motor in fall)
    assert all(abs(change[motor - 1]) <= 2 for motor in {1, 2, 3, 4} - {*rise, *fall})
