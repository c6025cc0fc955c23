"""Subscriptions and typed streams: values as they come, the last one, waiting for one; patterns that match no key."""

from __future__ import annotations

import asyncio
import importlib
from contextlib import asynccontextmanager

import pytest

from lab.places import ROOT
from mkdaemon.bus.keys import KEYS, Use
from mkdaemon.client import watch as watch_module
from mkdaemon.client.patterns import require_known
from mkdaemon.client.streams import Stream
from mkdaemon.errors import MkError, ProtocolError
from mkdaemon.telemetry.state import Attitude
from tests.client.fake import settle
from tools import client_sources

VALUES = [spec for spec in KEYS if spec.use in {Use.PUBLISHED, Use.CLIENT} and spec.carries is not None]


@asynccontextmanager
async def publishing(daemon):
    """Attitudes all the time, each with another yaw."""

    async def go_on():
        number = 0
        while True:
            number += 1
            daemon.publish_attitude(yaw=number / 1000)
            await asyncio.sleep(0.005)

    task = asyncio.create_task(go_on())
    yield
    task.cancel()


async def test_a_stream_gives_typed_values_in_their_order_and_one_is_waited_for(daemon, uav):
    async with publishing(daemon):
        yaws = []
        async for attitude in uav.state.attitude():
            assert isinstance(attitude, Attitude)
            yaws.append(attitude.yaw)
            if len(yaws) == 5:
                break
        assert yaws == sorted(set(yaws))
        assert isinstance(await anext(uav.state.attitude()), Attitude)
        found = await uav.state.attitude.until(lambda attitude: attitude.yaw > 0.01, patience=20.0)
        assert found.yaw > 0.01


async def test_a_slow_reader_loses_the_oldest_or_gets_the_newest_alone(daemon, uav, monkeypatch):
    async with uav.state.attitude.subscribed(backlog=1) as attitudes:
        await settle(uav)
        for number in range(20):
            daemon.publish_attitude(yaw=number / 100)
        await settle(uav)
        assert (await anext(attitudes)).yaw == 0.19
    monkeypatch.setattr(watch_module, "BACKLOG", 8)
    async with uav.watch("state/attitude") as samples:
        await settle(uav)
        await publish(daemon, 20)
        await asyncio.sleep(0.2)
        yaws = [round((await anext(samples)).fields["yaw"] * 1000) for _ in range(8)]
        assert yaws == list(range(12, 20))


async def test_the_last_value_comes_with_its_age_none_before_there_is_one_and_another_kind_is_an_error(daemon, uav):
    assert await uav.state.attitude.latest() is None
    daemon.publish_attitude(yaw=1.0)
    last = await uav.state.attitude.latest()
    assert last is not None
    assert last.value.yaw == 1.0
    assert 0.0 <= last.age < 5.0
    wrong = Stream(uav, "state/attitude", "state:Battery")
    with pytest.raises(ProtocolError, match=r"state/attitude carries Attitude\.v1, no Battery"):
        await wrong.latest()


@pytest.mark.parametrize("name", ["", "*", "a/b", "**"])
async def test_a_name_within_a_key_is_one_part_of_it(uav, name):
    with pytest.raises(MkError, match="is not a part of a key"):
        uav.vision(name)


def reach(uav, spec):
    """The stream of a line of the table, with `x` for every name."""
    found = uav
    for chunk in spec.suffix.split("/"):
        found = found("x") if chunk.startswith("<") and not isinstance(found, tuple) else getattr(found, chunk)
    return found


async def test_every_key_that_carries_values_is_a_stream_of_its_model(uav):
    for spec in VALUES:
        if spec.suffix.startswith(("rx/", "tx/")):
            root = spec.suffix[:2]
            stream = getattr(uav, root)("nc", "osd")
            wanted = f"{root}/nc/osd"
        else:
            stream, wanted = reach(uav, spec), "/".join("x" if c[0] == "<" else c for c in spec.suffix.split("/"))
        assert stream.suffix == wanted
        module, _, name = stream._model.partition(":")
        assert getattr(importlib.import_module(f"mkdaemon.telemetry.{module}"), name) is spec.carries


def test_the_committed_sources_are_those_of_the_tables():
    for name, make in (("keytree", client_sources.key_tree), ("verbcalls", client_sources.verb_calls)):
        path = ROOT / "src" / "mkdaemon" / "client" / f"{name}.py"
        assert path.read_text(encoding="utf-8") == make()


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


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        ("attitude", "did you mean state/attitude, setpoint/attitude or rx/fc/attitude?"),
        ("osd", "did you mean rx/nc/osd, "),
        ("stat/**", "did you mean state/**?"),
        ("state/nope/*", "did you mean state/gps or "),
        ("nope", "keys begin with raw, state, link, "),
    ],
)
def test_what_is_no_key_is_told_what_keys_there_are(pattern, words):
    with pytest.raises(MkError) as told:
        require_known(pattern)
    assert words in str(told.value)
