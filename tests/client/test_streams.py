"""Typed streams: values as they come, the last one, waiting for one."""

from __future__ import annotations

import ast
import asyncio
import importlib
from contextlib import asynccontextmanager

import pytest

from lab.places import ROOT
from mkdaemon.bus.keys import KEYS, KeySpec, Use
from mkdaemon.client.streams import Stream
from mkdaemon.errors import MkError, ProtocolError, SilenceError
from mkdaemon.telemetry.state import Attitude, Battery
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


async def test_a_stream_gives_typed_values_in_their_order(daemon, uav):
    async with publishing(daemon):
        yaws = []
        async for attitude in uav.state.attitude():
            assert isinstance(attitude, Attitude)
            yaws.append(attitude.yaw)
            if len(yaws) == 5:
                break
        assert yaws == sorted(set(yaws))
        assert isinstance(await anext(uav.state.attitude()), Attitude)


async def test_a_slow_reader_gets_the_newest_alone_if_it_wants(daemon, uav):
    async with uav.state.attitude.subscribed(backlog=1) as attitudes:
        await settle(uav)
        for number in range(20):
            daemon.publish_attitude(yaw=number / 100)
        await settle(uav)
        assert (await anext(attitudes)).yaw == 0.19


async def test_the_last_value_comes_with_its_age_and_none_before_there_is_one(daemon, uav):
    assert await uav.state.attitude.latest() is None
    daemon.publish_attitude(yaw=1.0)
    last = await uav.state.attitude.latest()
    assert last is not None
    assert last.value.yaw == 1.0
    assert 0.0 <= last.age < 5.0


async def test_a_value_is_waited_for(daemon, uav):
    async with publishing(daemon):
        found = await uav.state.attitude.until(lambda attitude: attitude.yaw > 0.01, patience=20.0)
        assert found.yaw > 0.01


async def test_silence_is_an_error_where_a_limit_is_given(uav):
    with pytest.raises(SilenceError, match=r"state/attitude has been silent for 0\.05 s"):
        await anext(uav.state.attitude(silence=0.05))
    with pytest.raises(SilenceError, match=r"state/attitude was not as wanted within 0\.05 s"):
        await uav.state.attitude.until(lambda _: True, patience=0.05)


async def test_a_value_of_another_kind_is_an_error_and_no_surprise(daemon, uav):
    daemon.publish_attitude(yaw=1.0)
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


def test_a_new_key_needs_a_line_of_the_table_and_nothing_else(monkeypatch):
    more = (
        KeySpec("state/wind", Use.PUBLISHED, Battery, "1 Hz", "Blows."),
        KeySpec("vision/<camera>/blur", Use.PUBLISHED, Battery, "1 Hz", "Blurs."),
        KeySpec("weather", Use.PUBLISHED, Battery, "1 Hz", "Changes."),
    )
    monkeypatch.setattr(client_sources, "KEYS", (*KEYS, *more))
    made = client_sources.key_tree()
    ast.parse(made)
    assert 'self.wind: Stream[Battery] = Stream(transport, "state/wind", "state:Battery")' in made
    assert 'f"vision/{part_of_key(camera)}/blur"' in made
    assert 'self.weather: Stream[Battery] = Stream(self, "weather", "state:Battery")' in made
