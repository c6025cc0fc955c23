"""The clock: stamps that follow a system clock somebody sets; and virtual time, which jumps where nothing is due."""

from __future__ import annotations

import asyncio
import os
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from mkdaemon.clock import LOOK_PERIOD, STEP, SYNCHRONISED_PERIOD, Clock, boot_id, kernel_synchronised
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


def test_a_step_says_when_how_far_and_in_which_direction():
    machine = Machine()
    machine.wall -= 3600.0
    machine.run(2 * LOOK_PERIOD)
    [step] = machine.clock.take_steps()
    assert (step.at, step.suspended) == (machine.monotonic, 0.0)
    assert step.step == pytest.approx(-3600.0)


def test_a_machine_that_slept_says_how_long():
    machine = Machine()
    machine.wall += 600.0
    machine.suspended += 590.0
    machine.run(1.0)
    [step] = machine.clock.take_steps()
    assert (step.step, step.suspended) == (pytest.approx(600.0), pytest.approx(590.0))


def test_a_slewed_clock_is_followed_without_an_event():
    machine = Machine()
    for _ in range(600):
        machine.run(LOOK_PERIOD)
        machine.wall += 0.0005 * LOOK_PERIOD  # 500 ppm, as NTP slews
        assert machine.clock.stamp().wall == pytest.approx(machine.wall, abs=1e-4)
    assert machine.clock.take_steps() == []


def test_the_kernel_is_asked_once_a_second_whether_it_is_synchronised():
    machine = Machine()
    machine.synchronised = None
    for _ in range(101):
        machine.run(SYNCHRONISED_PERIOD / 10)
        stamp = machine.clock.stamp()
    assert stamp.synchronised is None
    assert 9 <= machine.asked <= 12


def test_a_look_disturbed_by_a_pause_is_repeated():
    pauses = iter([0.0, 0.3])
    now = [10.0]

    def wall() -> float:
        now[0] += next(pauses, 0.0)  # the process is held up between two readings
        return now[0] + 1e9

    clock = Clock(monotonic=lambda: now[0], wall=wall, synchronised=lambda: None)
    now[0] += 1.0
    stamp = clock.stamp()
    assert stamp.wall - stamp.monotonic == pytest.approx(1e9, abs=1e-6)
    assert clock.take_steps() == []


def test_a_stamp_of_this_boot_is_taken_as_it_is_and_any_other_through_wall_time():
    machine = Machine()
    assert machine.clock.monotonic_of(Stamp(monotonic=990.0, wall=0.0, boot=boot_id())) == 990.0
    for boot in ("", "another"):
        elsewhere = Stamp(monotonic=5.0, wall=1.7e9 - 3, boot=boot)
        assert machine.clock.monotonic_of(elsewhere) == pytest.approx(997.0)


def test_a_stamp_is_finite_and_does_not_change():
    with pytest.raises(ValidationError):
        Stamp(monotonic=float("nan"), wall=1.0)
    with pytest.raises(ValidationError):
        Clock().stamp().wall = 0.0


def test_the_machine_itself():
    clock = Clock()
    stamp = clock.stamp()
    assert abs(stamp.wall - time.time()) < 1.0
    assert len(boot_id()) == 8
    assert stamp.synchronised in (True, False, None)
    assert kernel_synchronised() in (True, False, None)


def test_two_threads_find_a_step_once():
    machine = Machine()
    machine.wall += 50.0
    machine.run(1.0)
    threads = [threading.Thread(target=machine.clock.stamp) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(machine.clock.take_steps()) == 1


def test_time_jumps_to_the_next_timer():
    async def main():
        await asyncio.sleep(3600.0)
        return asyncio.get_running_loop().time()

    assert run_virtually(main()) == 3600.0


def test_what_another_thread_wants_is_done_before_time_passes():
    async def main():
        loop = asyncio.get_running_loop()
        done = loop.create_future()
        thread = threading.Thread(target=lambda: loop.call_soon_threadsafe(done.set_result, None))
        timer = loop.call_later(1.0, done.cancel)
        thread.start()
        thread.join()
        await done
        timer.cancel()
        return loop.time()

    assert run_virtually(main()) == 0.0


def test_a_file_that_can_be_read_is_read_before_time_passes():
    reading, writing = os.pipe()

    async def main():
        loop, seen = asyncio.get_running_loop(), []
        loop.add_reader(reading, lambda: seen.append((loop.time(), os.read(reading, 1))))
        loop.call_later(1.0, os.write, writing, b"x")
        await asyncio.sleep(2.0)
        loop.remove_reader(reading)
        return seen

    assert run_virtually(main()) == [(1.0, b"x")]
    os.close(reading)
    os.close(writing)


def test_waiting_for_what_never_comes_is_an_error():
    async def main():
        await asyncio.get_running_loop().create_future()

    with pytest.raises(RuntimeError, match="everything waits"):
        run_virtually(main())


def test_what_still_runs_at_the_end_has_the_time_to_leave():
    left = []

    async def leave_slowly():
        try:
            await asyncio.sleep(3600.0)
        finally:
            await asyncio.sleep(1.0)
            left.append(asyncio.get_running_loop().time())

    async def main():
        task = asyncio.create_task(leave_slowly())
        await asyncio.sleep(5.0)
        return task

    assert run_virtually(main()).done()
    assert left == [6.0]
