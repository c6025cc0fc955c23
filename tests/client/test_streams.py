"""Subscriptions and typed streams: values as they come, the last one, waiting for one; patterns that match no key."""

from __future__ import annotations

import asyncio
import importlib
from contextlib import asynccontextmanager

import pytest

from lab.places import ROOT
from mkdaemon.bus.keys import KEYS, Use
from mkdaemon.client import watch as watch_module
from mkdaemon.client.patterns import is_known, known_keys, require_known
from mkdaemon.client.streams import Stream
from mkdaemon.errors import MkError, ProtocolError, SilenceError
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


async def test_silence_is_an_error_where_a_limit_is_given(uav):
    with pytest.raises(SilenceError, match=r"state/attitude has been silent for 0\.05 s"):
        await anext(uav.state.attitude(silence=0.05))
    with pytest.raises(SilenceError, match=r"state/attitude was not as wanted within 0\.05 s"):
        await uav.state.attitude.until(lambda _: True, patience=0.05)


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


async def test_entering_subscribes_at_once_so_that_nothing_is_missed(daemon, uav):
    async with uav.watch("state/attitude", "control/*") as samples:
        await settle(uav)
        await publish(daemon, 3)
        daemon.say(daemon.phase, "nobody")
        seen = [await anext(samples) for _ in range(4)]
        assert [sample.suffix for sample in seen] == ["state/attitude"] * 3 + ["control/status"]


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


@pytest.mark.parametrize(
    "pattern",
    ["state/attitude", "state/*", "**", "*", "*/status", "rx/nc/osd", "rx/*/osd", "tx/any/*", "rx/fc/unknown",
     "vision/down/pose", "vision/*/stats", "setpoint/stick", "event/mission", "health", "tf"],
)  # fmt: skip
def test_patterns_of_keys_that_exist_are_known(pattern):
    require_known(pattern)


@pytest.mark.parametrize(
    ("pattern", "nearest"),
    [
        ("state/atitude", "state/attitude"),
        ("state/attitude/*", "state/attitude"),
        ("rx/nc/ods", "rx/nc/osd"),
        ("rx/fc/osd", "rx/nc/osd"),
        ("control/staus", "control/status"),
        ("vision/down/poses", "vision/*/pose"),
    ],
)
def test_a_misspelt_pattern_names_the_nearest_key(pattern, nearest):
    with pytest.raises(MkError, match=r"^no key matches") as told:
        require_known(pattern)
    assert f"did you mean {nearest}" in str(told.value)


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


@pytest.mark.parametrize("pattern", ["do/lease", "cmd/fc/version_request", "schema/Attitude.v1", "alive", "xyzzy"])
def test_what_is_asked_and_never_published_is_no_key_to_watch(pattern):
    assert not is_known(pattern)


def test_frames_are_known_by_board_and_message():
    known = known_keys()
    assert {"rx/nc/osd", "rx/fc/attitude", "tx/fc/settings_request", "rx/other/unknown"} <= set(known)
    assert len(known) == len(set(known))
