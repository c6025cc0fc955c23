"""The clock: stamps that follow a system clock somebody sets; and virtual time that waits for nothing."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.clock import LOOK_PERIOD, STEP, Clock, boot_id
from mkdaemon.stamp import Stamp
from mkdaemon.virtualtime import run_virtually


class Machine:
    """A machine whose clocks the test moves."""

    def __init__(self) -> None:
        self.monotonic = 1000.0
        self.wall = 1.7e9
        self.suspended = 0.0
        self.synchronised: bool | None = True
        self.asked = 0
        self.clock = Clock(
            monotonic=lambda: self.monotonic,
            wall=lambda: self.wall,
            synchronised=self._ask,
            suspended=lambda: self.suspended,
        )

    def _ask(self) -> bool | None:
        self.asked += 1
        return self.synchronised

    def run(self, seconds: float) -> None:
        self.monotonic += seconds
        self.wall += seconds


def test_wall_time_is_monotonic_time_plus_the_offset():
    machine = Machine()
    stamp = machine.clock.stamp(999.5)
    assert (stamp.monotonic, stamp.wall) == (999.5, 1.7e9 - 0.5)
    machine.run(7.0)
    assert machine.clock.stamp() == Stamp(monotonic=1007.0, wall=1.7e9 + 7, boot=boot_id(), synchronised=True)


@given(st.lists(st.floats(-1e5, 1e5).filter(lambda step: abs(abs(step) - STEP) > 1e-3), max_size=5))
def test_stamps_follow_every_step_after_one_look(steps):
    machine = Machine()
    for step in steps:
        machine.wall += step
        machine.run(LOOK_PERIOD)
        assert machine.clock.stamp().wall == pytest.approx(machine.wall, abs=1e-3)
    told = machine.clock.take_steps()
    assert [found.step for found in told] == pytest.approx([step for step in steps if abs(step) > STEP], abs=1e-3)
    assert machine.clock.take_steps() == []


def test_a_slewed_clock_is_followed_without_an_event():
    machine = Machine()
    for _ in range(600):
        machine.run(LOOK_PERIOD)
        machine.wall += 0.0005 * LOOK_PERIOD  # 500 ppm, as NTP slews
        assert machine.clock.stamp().wall == pytest.approx(machine.wall, abs=1e-4)
    assert machine.clock.take_steps() == []


def test_a_stamp_of_this_boot_is_taken_as_it_is_and_any_other_through_wall_time():
    machine = Machine()
    assert machine.clock.monotonic_of(Stamp(monotonic=990.0, wall=0.0, boot=boot_id())) == 990.0
    for boot in ("", "another"):
        elsewhere = Stamp(monotonic=5.0, wall=1.7e9 - 3, boot=boot)
        assert machine.clock.monotonic_of(elsewhere) == pytest.approx(997.0)


def test_waiting_for_what_never_comes_is_an_error():
    async def main():
        await asyncio.get_running_loop().create_future()

    with pytest.raises(RuntimeError, match="everything waits"):
        run_virtually(main())
