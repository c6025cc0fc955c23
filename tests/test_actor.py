"""Who acts on the loop: what a replay runs again is known by its task, everything else by nothing."""

from __future__ import annotations

import asyncio

from mkdaemon.actor import CALLBACK, INPUT, act, acting, current_actor, taking


async def test_tasks_and_their_children_act_under_their_names():
    async def parent():
        return current_actor(), await asyncio.create_task(child(), name="child")

    async def child():
        return current_actor()

    assert await asyncio.create_task(act(parent()), name="parent") == ("parent", "child")
    assert await child() is None


async def test_a_timer_of_a_task_that_acts_is_a_callback():
    fired = asyncio.get_running_loop().create_future()

    async def set_timer():
        asyncio.get_running_loop().call_later(0.0, lambda: fired.set_result(current_actor()))

    await asyncio.create_task(act(set_timer()))
    assert await fired == CALLBACK


async def test_a_task_acts_for_a_while():
    task = asyncio.current_task()
    task.set_name("bus")
    with acting("answer 1"):
        assert current_actor() == "answer 1"
    assert current_actor() is None
    assert task.get_name() == "bus"


async def test_what_is_taken_from_outside_is_an_input():
    assert taking(lambda word: (word, current_actor()))("setpoint") == ("setpoint", INPUT)
    assert current_actor() is None
