"""A loop that runs what waits in the order of a recording, in its time."""

from __future__ import annotations

import asyncio

import pytest

from mkdaemon.actor import act
from mkdaemon.record.entry import Entry, Kind, TimeBase
from mkdaemon.record.looks import Look
from mkdaemon.replay.script import Moment, Script
from mkdaemon.replay.timing import ReplayClock, ReplayLoop
from mkdaemon.virtualtime import end_loop


def run(looks, work, inputs=()):
    """Run `work(loop, clock, seen, arrived)`; returns what was seen."""
    base = TimeBase("", 0)
    moments = [Moment(at, Entry(Kind.PORT_READ, "mk/t/port", b"", "", at, 0.0, base, 1), place) for at, place in inputs]
    loop = ReplayLoop(Script([Look(*look) for look in looks], moments), 100.0)
    clock, seen, arrived = ReplayClock(loop, lambda at: 1e9), [], asyncio.Event()
    ended = loop.create_future()
    loop.follow(lambda moment: arrived.set(), lambda: ended.done() or ended.set_result(None))
    try:
        loop.run_until_complete(work(loop, clock, seen, arrived, ended))
    finally:
        end_loop(loop)
    return seen


def task(loop, name, work):
    return loop.create_task(act(work), name=name)


def test_tasks_run_in_the_order_in_which_they_looked():
    async def look(name, clock, seen):
        seen.append((name, clock.now()))
        await asyncio.sleep(0)
        seen.append((name, clock.now()))

    async def work(loop, clock, seen, arrived, ended):
        first, second = task(loop, "a", look("a", clock, seen)), task(loop, "b", look("b", clock, seen))
        await asyncio.wait({first, second})

    order = [("b", 100.1), ("a", 100.2), ("b", 100.3), ("a", 100.4)]
    assert run(order, work) == order


@pytest.mark.parametrize("woke", [100.49, 100.5, 100.9])
def test_a_timer_fires_when_its_task_looked(woke):
    async def sleep(clock, seen):
        clock.now()
        await asyncio.sleep(0.5)
        seen.append(clock.now())

    async def work(loop, clock, seen, arrived, ended):
        await task(loop, "a", sleep(clock, seen))

    assert run([("a", 100.0), ("a", woke)], work) == [woke]


def test_a_timer_waits_for_what_came_in_before_it():
    async def sleep(clock, seen, arrived):
        clock.now()
        await asyncio.sleep(0.5)
        seen.append((clock.now(), arrived.is_set()))

    async def work(loop, clock, seen, arrived, ended):
        await task(loop, "a", sleep(clock, seen, arrived))

    assert run([("a", 100.1), ("a", 100.7)], work, inputs=[(100.65, 1)]) == [(100.7, True)]


def test_a_timer_of_a_task_that_never_looked_fires_when_it_is_due():
    async def sleep(loop, seen):
        await asyncio.sleep(0.5)
        seen.append(loop.time())

    async def work(loop, clock, seen, arrived, ended):
        new = task(loop, "new", sleep(loop, seen))
        await arrived.wait()
        seen.append(loop.time())
        await new

    assert run([("a", 100.4), ("a", 100.8)], work, inputs=[(100.6, 1)]) == [100.5, 100.6]


def test_a_timer_that_belongs_to_no_task_looks_as_a_callback():
    async def work(loop, clock, seen, arrived, ended):
        async def set_timer():
            loop.call_later(0.1, lambda: seen.append(clock.now()))

        await task(loop, "a", set_timer())
        await ended

    assert run([("", 100.3)], work) == [100.3]


def test_who_looks_more_often_sees_the_time_stand_still():
    async def work(loop, clock, seen, arrived, ended):
        async def look():
            seen.extend([clock.now(), clock.now()])
            await arrived.wait()
            seen.append(clock.stamp().wall)

        await task(loop, "a", look())

    assert run([("a", 100.1), ("a", 100.6)], work, inputs=[(100.5, 1)]) == [100.1, 100.1, 1e9 + 100.6]


def test_what_came_in_while_a_task_was_at_work_comes_before_it_goes_on():
    async def work(loop, clock, seen, arrived, ended):
        async def look():
            seen.append(clock.now())
            loop.bring_what_follows()
            seen.append(arrived.is_set())

        await task(loop, "a", look())

    assert run([("a", 100.1), ("b", 100.2)], work, inputs=[(100.15, 1)]) == [100.1, True]


def test_looks_that_nobody_takes_are_left_out():
    async def work(loop, clock, seen, arrived, ended):
        seen.append(clock.now())
        await ended
        seen.append(loop.time())

    assert run([("gone", 100.1), ("gone", 100.2)], work) == [100.0, 100.0]


def test_after_the_end_timers_fire_when_due_and_a_cancelled_one_never_does():
    async def work(loop, clock, seen, arrived, ended):
        loop.call_later(0.1, seen.append, "cancelled").cancel()
        loop.call_soon(seen.append, "cancelled").cancel()
        await ended
        await asyncio.sleep(0.3)
        seen.append(loop.time())
        loop.call_soon_threadsafe(seen.append, "thread")
        await asyncio.sleep(0)

    assert run([], work) == [100.3, "thread"]


def test_a_task_that_waits_for_nothing_is_an_error():
    async def work(loop, clock, seen, arrived, ended):
        await ended
        await arrived.wait()

    with pytest.raises(RuntimeError, match="everything waits"):
        run([], work)


def test_what_was_read_in_the_breath_of_the_order_to_stop_is_read_before_the_reader_is_stopped():
    async def read(clock, seen, bytes_came):
        clock.now()
        await bytes_came.wait()
        seen.append(clock.now())
        await asyncio.sleep(10.0)

    async def stop(told, reader):
        await told.wait()
        await asyncio.sleep(0)  # others are told first, as a daemon does
        reader.cancel()

    async def work(loop, clock, seen, arrived, ended):
        bytes_came = asyncio.Event()
        inputs = iter((arrived, bytes_came))
        loop.follow(lambda moment: next(inputs).set(), lambda: None)
        reader = task(loop, "reader", read(clock, seen, bytes_came))
        await task(loop, "stop", stop(arrived, reader))
        await asyncio.wait({reader})

    looks = [("reader", 100.0), ("reader", 100.500008)]
    assert run(looks, work, inputs=[(100.5, 1), (100.500004, 1)]) == [100.500008]
