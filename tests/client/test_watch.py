"""Subscriptions as iterators."""

from __future__ import annotations

import asyncio

import pytest

from mkdaemon.client import watch as watch_module
from mkdaemon.errors import MkError
from tests.client.fake import settle


async def publish(daemon, count):
    """So many attitudes, one a turn."""
    for number in range(count):
        daemon.publish_attitude(yaw=number / 1000)
        await asyncio.sleep(0)


async def test_a_loop_subscribes_and_a_break_ends_the_subscription(daemon, uav):
    async def go_on():
        while True:
            daemon.publish_attitude(yaw=0.5)
            await asyncio.sleep(0.01)

    publishing = asyncio.create_task(go_on())
    watch = uav.watch("state/*")
    async for sample in watch:
        assert sample.value.yaw == 0.5
        break
    for _ in range(3):
        await asyncio.sleep(0)  # the loop closes the iterator that was left
    assert watch._subscribers == []
    publishing.cancel()


async def test_entering_subscribes_at_once_so_that_nothing_is_missed(daemon, uav):
    async with uav.watch("state/attitude", "control/*") as samples:
        await settle(uav)
        await publish(daemon, 3)
        daemon.say(daemon.phase, "nobody")
        seen = [await anext(samples) for _ in range(4)]
        assert [sample.suffix for sample in seen] == ["state/attitude"] * 3 + ["control/status"]


async def test_a_slow_reader_loses_the_oldest(daemon, uav, monkeypatch):
    monkeypatch.setattr(watch_module, "BACKLOG", 8)
    async with uav.watch("state/attitude") as samples:
        await settle(uav)
        await publish(daemon, 20)
        await asyncio.sleep(0.2)
        yaws = [round((await anext(samples)).fields["yaw"] * 1000) for _ in range(8)]
        assert yaws == list(range(12, 20))


async def test_a_whole_key_is_understood_and_a_wrong_one_refused_at_once(uav):
    uav.watch("mk/fake/state/attitude")
    with pytest.raises(MkError, match="did you mean state/attitude"):
        uav.watch("mk/fake/state/atitude")
    with pytest.raises(MkError, match="'a//b' is not a key: empty chunks are forbidden"):
        uav.watch("a//b")


async def test_what_comes_together_wakes_the_loop_once_and_stays_in_order():
    loop = asyncio.get_running_loop()
    calls = []

    class Counting:
        def call_soon_threadsafe(self, call):
            calls.append(call)
            loop.call_soon(call)

    handover, taken = watch_module.Handover(Counting()), []
    for number in range(5):
        handover.arrived(taken.append, number)
    assert len(calls) == 1
    await asyncio.sleep(0)
    handover.arrived(taken.append, 5)
    await asyncio.sleep(0)
    assert taken == [0, 1, 2, 3, 4, 5]
    assert len(calls) == 2
