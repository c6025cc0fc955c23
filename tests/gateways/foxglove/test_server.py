"""The server before viewers of its own: what is subscribed, who is given what, and viewers that hang."""

from __future__ import annotations

import asyncio
import json
import os
import time
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path

import pytest
import websockets
import zenoh
from structlog.testing import capture_logs

from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import encode, encoding_of, with_age
from mkdaemon.client import Vehicle
from mkdaemon.client.player import Player, PlayPace, open_player_session
from mkdaemon.client.playselection import PlaySelection, RecordedSamples
from mkdaemon.gateways.foxglove import exhibit
from mkdaemon.gateways.foxglove.exhibit import Feed
from mkdaemon.gateways.foxglove.server import BACKLOG, serving
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.reader import Recording
from mkdaemon.stamp import nanoseconds
from mkdaemon.telemetry.event import LogEvent
from mkdaemon.telemetry.record import BusCounts
from tests import samples
from tests.gateways.foxglove.viewer import SUBPROTOCOL, complaints, viewing
from tests.places import DATA

TARGET = DATA / "recordings" / "fc_over_target.mcap"


class Aircraft:
    """What the bus has of a daemon: its token, values, and the last ones for who asks."""

    def __init__(self, session, name):
        self.session, self.name = session, name
        self.last, self.asked = {}, []

    def put(self, suffix, value):
        self.last[suffix] = value
        self.session.put(f"mk/{self.name}/{suffix}", encode(value), encoding=encoding_of(type(value)))

    def answer(self, query):
        self.asked.append(str(query.key_expr).removeprefix(f"mk/{self.name}/"))
        for suffix, value in self.last.items():
            whole = f"mk/{self.name}/{suffix}"
            if query.key_expr.intersects(whole):
                query.reply(whole, with_age(encode(value), 1.0), encoding=encoding_of(type(value)))

    def is_watched(self, suffix):
        publisher = self.session.declare_publisher(f"mk/{self.name}/{suffix}")
        found = publisher.matching_status.matching
        publisher.undeclare()
        return found


@asynccontextmanager
async def flying(*names):
    """Aircraft on a bus of their own, and the address of a gateway that shows them."""
    async with open_player_session(connect=(), listen=None, alone=True) as session:
        with ExitStack() as stack:
            fleet = [Aircraft(session, name) for name in names]
            for one in fleet:
                handler = zenoh.handlers.Callback(one.answer, indirect=False)
                stack.enter_context(session.declare_queryable(f"mk/{one.name}/**", handler))
                stack.enter_context(session.liveliness().declare_token(f"mk/{one.name}/alive"))
            async with serving(Vehicle(session, names[0], "here"), names, port=0) as address:
                yield address, *fleet


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(exhibit, "LOOK_PERIOD", 0.1)


@pytest.fixture
async def uav():
    """An aircraft that is shown."""
    async with flying("mk1") as (address, found):
        found.shown_at = address
        yield found


@pytest.fixture
async def viewer(uav):
    async with viewing(uav.shown_at) as found:
        yield found


async def test_what_is_advertised_can_be_read_and_says_what_it_is(uav):
    uav.put("vision/down/setup", samples.setup(1.0))
    async with viewing(uav.shown_at) as viewer:
        await wait_until(lambda: "/camera/down/image" in viewer.channels)
        assert viewer.info["name"] == "mkdaemon"
        assert viewer.info["capabilities"] == ["time"]
        assert {"/scene", "/tf", "/fix", "/log", "/state/attitude", "/vision/down/pose"} <= viewer.channels.keys()
        assert viewer.channels["/scene"]["schemaName"] == "foxglove.SceneUpdate"
        assert viewer.channels["/state/attitude"]["schemaName"] == "mk.Attitude.v1"
        for topic, channel in viewer.channels.items():
            if channel["encoding"] == "json":
                assert list(complaints(json.loads(channel["schema"]))) == [], topic


async def test_only_what_somebody_looks_at_is_subscribed_on_the_bus(uav):
    assert not uav.is_watched("**")
    async with viewing(uav.shown_at) as viewer:
        await viewer.subscribe("/state/attitude", "/tf")
        await wait_until(lambda: uav.is_watched("state/attitude") and uav.is_watched("vision/down/pose"))
        assert not uav.is_watched("raw/rx")
        await viewer.unsubscribe()
        await wait_until(lambda: not uav.is_watched("**"))
        await viewer.subscribe("/link/health")
        await wait_until(lambda: uav.is_watched("link/health"))
    await wait_until(lambda: not uav.is_watched("**"))  # its connection is gone


async def test_values_do_not_wait_for_the_loop_and_end_with_the_subscription():
    taken = []
    async with open_player_session(connect=(), listen=None, alone=True) as session:
        uav, feed = Aircraft(session, "mk1"), Feed(lambda sample: taken.append(sample.value.stamp.monotonic))
        feed.want({"state/attitude"})
        feed.follow(Vehicle(session, "mk1", "here"))
        for at, patterns in ((1.0, {"state/attitude"}), (2.0, {"state/*"}), (3.0, {"state/gps"}), (4.0, {"state/*"})):
            feed.want(patterns)
            uav.put("state/attitude", samples.attitude(at))
            session.delete("mk/mk1/state/attitude")
        feed.want(())
        uav.put("state/attitude", samples.attitude(5.0))
    assert taken == [1.0, 2.0, 4.0], "no turn of the loop between"


async def test_a_value_comes_once_however_many_channels_are_made_of_its_key(uav, viewer):
    await viewer.subscribe("/state/attitude")
    await wait_until(lambda: uav.is_watched("state/attitude"))
    await viewer.subscribe("/diagnostics", "/tf", "/scene")  # of state/*, which holds the key, too
    await wait_until(lambda: uav.is_watched("state/gps"))
    await asyncio.sleep(0.2)  # the narrow subscription ends behind the wide one
    for number in range(20):
        uav.put("state/attitude", samples.attitude(1.0 + number))
    await wait_until(lambda: len(viewer.of("/state/attitude")) >= 20)
    await asyncio.sleep(0.2)
    assert [one["stamp"]["monotonic"] for one in viewer.of("/state/attitude")] == [1.0 + n for n in range(20)]


async def test_keys_that_come_later_are_found_by_what_the_daemon_counts(quick, uav, viewer):
    uav.put("bus/counts", BusCounts(stamp=samples.stamp(1.0), counts={"state/attitude": 5}))
    await viewer.subscribe("/state/attitude")
    await wait_until(lambda: uav.asked.count("bus/counts") > 3)
    uav.asked.clear()
    uav.put("vision/down/setup", samples.setup(2.0))
    uav.put("rx/nc/osd", samples.alive(2.0))
    counts = {"state/attitude": 9, "vision/down/setup": 1, "rx/nc/osd": 1}
    uav.put("bus/counts", BusCounts(stamp=samples.stamp(2.0), counts=counts))
    await wait_until(lambda: {"/camera/down/image", "/rx/nc/osd"} <= viewer.channels.keys())
    await wait_until(lambda: uav.asked.count("bus/counts") > 3)
    asked = [key for key in uav.asked if key != "bus/counts"]
    assert sorted(asked) == ["rx/nc/osd", "vision/down/setup"], "each is asked for once, and nothing else is"


async def test_who_comes_is_given_the_last_values_and_nobody_else(uav):
    async with viewing(uav.shown_at) as one, viewing(uav.shown_at) as other:
        uav.put("event/log", LogEvent(stamp=samples.stamp(1.0), level="info", text="hello"))
        uav.put("vision/down/setup", samples.setup(1.0))
        uav.put("control/estimate", samples.estimate(2.0))
        await one.subscribe("/log", "/scene", "/control/estimate")
        await one.first("/log", "/scene", "/control/estimate")
        assert [line["message"] for line in one.of("/log")] == ["hello"]
        assert "age" not in one.of("/control/estimate")[0]
        await other.subscribe("/log", "/scene")
        await other.first("/log")
        await wait_until(lambda: {"target", "vehicle"} <= {e["id"] for u in other.of("/scene") for e in u["entities"]})
        uav.put("event/log", LogEvent(stamp=samples.stamp(3.0), level="info", text="again"))
        await wait_until(lambda: len(one.of("/log")) == len(other.of("/log")) == 2)
        assert [line["message"] for line in one.of("/log")] == ["hello", "again"]


async def test_vehicles_have_topics_and_frames_of_their_own_and_may_come_later():
    async with flying("one", "two") as (address, one, two), viewing(address) as viewer:
        await viewer.subscribe("/one/tf", "/two/state/attitude", "/two/tf")
        await wait_until(lambda: one.is_watched("tf") or one.is_watched("control/estimate"))
        await wait_until(lambda: two.is_watched("state/attitude"))
        one.put("control/estimate", samples.estimate(1.0))
        two.put("state/attitude", samples.attitude(9.0))
        await viewer.first("/one/tf", "/two/state/attitude", "/two/tf")
        assert {edge["child_frame_id"] for edge in viewer.of("/one/tf")[0]["transforms"]} == {
            "one/map",
            "one/base_link",
        }
        assert viewer.of("/two/tf")[0]["transforms"][0]["parent_frame_id"] == "two/map"
        assert viewer.times == [nanoseconds(1.7e9 + 1.0)]  # the first one's time


async def test_a_vehicle_that_is_not_there_yet_is_shown_when_it_comes():
    async with open_player_session(connect=(), listen=None, alone=True) as session:
        uav = Aircraft(session, "mk1")
        async with serving(Vehicle(session, "mk1", "here"), ["mk1"], port=0) as address, viewing(address) as viewer:
            await viewer.subscribe("/state/attitude")
            with session.liveliness().declare_token("mk/mk1/alive"):
                await wait_until(lambda: uav.is_watched("state/attitude"))
                uav.put("state/attitude", samples.attitude(1.0))
                await viewer.first("/state/attitude")
            uav.put("state/attitude", samples.attitude(2.0))  # the word that it is gone may come before its last values
            await wait_until(lambda: viewer.of("/state/attitude")[-1]["stamp"]["monotonic"] == 2.0)


async def test_a_recording_that_is_played_is_shown_value_by_value():
    async with open_player_session(connect=(), listen=None, alone=True) as session:
        selection = PlaySelection.of(RecordedSamples(TARGET), None)
        (name,) = selection.names
        player = Player(session, selection, PlayPace(8.0, selection.first, time.monotonic()), TARGET.name)
        with player.answering():
            async with serving(Vehicle(session, name, "here"), [name], port=0) as address, viewing(address) as viewer:
                await viewer.subscribe("/state/attitude", "/raw/rx", "/control/estimate", "/tf", "/log", "/diagnostics")
                await player.wait_for_subscribers()
                await player.play()
                wanted = {
                    suffix: [
                        nanoseconds(entry.stamp.wall)
                        for entry in Recording(TARGET).entries(lambda facts: facts.kind is EntryKind.SAMPLE)
                        if entry.key == f"mk/{name}/{suffix}"
                    ]
                    for suffix in ("state/attitude", "raw/rx", "control/estimate")
                }

                def came(suffix):
                    return [one.log_time for one in viewer.seen if one.topic == f"/{suffix}"]

                await wait_until(lambda: all(len(came(suffix)) >= len(times) for suffix, times in wanted.items()))
        assert {suffix: came(suffix) for suffix in wanted} == wanted
        assert viewer.times == sorted(viewer.times)
        assert {edge["parent_frame_id"] for tree in viewer.of("/tf") for edge in tree["transforms"]} >= {"pad", "map"}
        assert viewer.of("/log")


def _resident():
    """Memory of this process [bytes]."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


async def test_a_viewer_that_hangs_costs_a_bounded_queue_and_the_others_nothing(uav, viewer):
    size, count = 40_000, 1500
    async with websockets.connect(uav.shown_at, subprotocols=[SUBPROTOCOL], max_queue=1) as hung:
        await viewer.subscribe("/event/log")
        number = viewer.channels["/event/log"]["id"]
        await hung.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": number}]}))
        await wait_until(lambda: uav.is_watched("event/log"))
        text, before = "x" * size, _resident()
        for place in range(count):
            uav.put("event/log", LogEvent(stamp=samples.stamp(place), level="info", text=f"{place} {text}"))
            if place % 25 == 0:
                await wait_until(lambda place=place: len(viewer.seen) > place)
                for one in viewer.seen:
                    one.value["text"] = one.value["text"][:10]
        await wait_until(lambda: len(viewer.seen) == count)
        assert count * size > 5 * BACKLOG * size
        assert _resident() - before < 2 * BACKLOG * size + 20e6
        hung.transport.abort()  # it never reads, so it never answers that it closes
    assert [int(one["text"].split()[0]) for one in viewer.of("/event/log")] == list(range(count))


@pytest.mark.parametrize("offered", [["foxglove.websocket.v1"], None])
async def test_a_viewer_of_the_old_protocol_is_refused_with_the_reason_in_the_log(uav, offered):
    with capture_logs() as logged:
        with pytest.raises(websockets.InvalidStatus, match="400"):
            await websockets.connect(uav.shown_at, subprotocols=offered)
        await wait_until(lambda: any(one["event"] == "viewer_refused" for one in logged))
    (refused,) = (one for one in logged if one["event"] == "viewer_refused")
    assert refused["viewer"].startswith("127.0.0.1:")
    assert "foxglove.sdk.v1" in refused["words"]
    assert "update it" in refused["words"]
