"""Recordings on the bus again: pace, keys that may be played, and everything counted."""

from __future__ import annotations

import asyncio
import time
from contextlib import asynccontextmanager

import msgpack
import pytest
import zenoh

from lab.rigs.waiting import wait_until
from mkdaemon.bus.keys import KEYS, Use
from mkdaemon.client import connect
from mkdaemon.client.player import FASTEST, Player, PlayPace, open_player_session
from mkdaemon.client.playselection import PlayKey, PlaySelection, RecordedSamples, play_key
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.layout import ChannelFacts
from mkdaemon.record.reader import Recording
from mkdaemon.telemetry.play import PlayState
from mkdaemon.telemetry.refusals import Token
from tests.bus.support import client, free_endpoint
from tests.places import DATA
from tests.record.support import sample

STICKS = DATA / "recordings" / "fc_sticks.mcap"


def samples():
    return Recording(STICKS).entries(lambda facts: facts.kind is EntryKind.SAMPLE)


class Listed:
    """Entries of any kind, as a recording of them would give them."""

    def __init__(self, entries):
        self._entries = entries

    def times(self, progress):
        return ((ChannelFacts.of(entry), entry.base.file_time(entry.received)) for entry in self._entries())

    def entries(self, first, last=None, choice=None):
        return self._entries()

    def latest(self, before):
        return []


def everything():
    return Recording(STICKS).entries()


def test_time_of_the_recording_follows_speed_pause_and_steps():
    pace = PlayPace(2.0, 100.0, 0.0)
    assert pace.wait(104.0, 0.0) == 2.0
    pace.toggle(1.0)
    assert pace.wait(104.0, 50.0) is None
    assert pace.place(50.0) == 102.0
    pace.step(50.0)
    assert pace.wait(103.0, 50.0) == 0.0
    assert pace.wait(103.5, 50.0) is None
    pace.toggle(60.0)
    assert pace.wait(104.0, 60.0) == 0.5
    pace.change_speed(0.5, 60.0)
    assert pace.wait(104.0, 60.0) == 1.0
    pace.change_speed(1e9, 60.0)
    assert pace.speed == FASTEST
    pace.restart(100.0, 61.0)
    assert pace.place(61.0) == 100.0


@pytest.mark.parametrize(
    "spec",
    [spec for spec in KEYS if spec.use not in {Use.PUBLISHED, Use.CLIENT} or spec.suffix.startswith("joy/")],
    ids=lambda s: s.suffix,
)
def test_no_key_that_commands_can_be_made(spec):
    suffix = spec.suffix.replace("<", "").replace(">", "")
    assert play_key(f"mk/mk1/{suffix}", None) is None
    assert play_key(f"mk/mk1/{suffix}", "show") is None
    for root in ("mk", "replay", "else"):
        with pytest.raises(ValueError, match="cannot put"):
            PlayKey(f"{root}/mk1/{suffix}")


STRANGE_KEYS = [
    *("mk/live/do/lease", "mk/live/setpoint/stick", "mk/live/cmd/fc/version_request", "mk/live/joy/pad"),
    *("mk/live/alive", "mk/*/state/attitude", "mk/**/state/attitude", "mk/a$*/state/attitude", "mk/live/rx/fc/*"),
    *("mk/live/rx/**", "mk/live/vision/$*/pose", "mk/live/state/attitude?x", "mk/live/do/../state/attitude"),
    *("mk/live/state/attitude/../../setpoint/stick", "mk//state/attitude", "mk/live do/state/attitude"),
    *("mk/live/setpoint/state/attitude", "mk/state/attitude", "do/live/state/attitude", "mk", ""),
]


@pytest.mark.parametrize("key", STRANGE_KEYS)
@pytest.mark.parametrize("name", [None, "live", "setpoint", "do"])
def test_no_recorded_key_and_no_name_lead_to_one_that_commands(key, name):
    assert play_key(key, name) is None
    with pytest.raises(ValueError, match="cannot put"):
        PlayKey(key)


class Listener:
    """Everything that arrives under a pattern."""

    def __init__(self, session, pattern):
        self.heard = []
        session.declare_subscriber(pattern, zenoh.handlers.Callback(self._take, indirect=False))

    def _take(self, sample):
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)))


@asynccontextmanager
async def a_player(name="show", speed=1.0, source=None, **pace):
    """A player of a recording with its selection and where it is reached; it is stopped at the end."""
    endpoint = free_endpoint()
    async with open_player_session(connect=[], listen=endpoint) as session:
        selection = PlaySelection.of(source or RecordedSamples(STICKS), name)
        now = time.monotonic() if speed < 1.0 else 0.0
        player = Player(session, selection, PlayPace(speed, selection.first, now, **pace), "fc_sticks.mcap")
        yield player, selection, endpoint
        player.stop()


async def test_what_is_played_is_what_was_recorded_byte_by_byte_and_in_order():
    async with a_player(None, 1000.0, Listed(everything)) as (player, selection, endpoint):
        with client(endpoint) as watcher:
            listener = Listener(watcher, "replay/t/**")
            async with asyncio.timeout(20):
                await player.wait_for_subscribers()
                await player.play()
                await wait_until(lambda: len(listener.heard) >= selection.total, 15.0)
    recorded = [(entry.key.replace("mk/", "replay/", 1), entry.payload, entry.encoding) for entry in samples()]
    assert listener.heard == recorded
    assert player.missing == {}
    assert player.sent.total == len(recorded)


async def test_a_daemon_that_comes_up_under_the_name_ends_playing_and_one_that_is_there_refuses_it():
    async with a_player(speed=1e-3) as (player, _, endpoint):
        with client(endpoint) as other:
            await player.refuse_live_daemons()
            task = asyncio.create_task(player.play())
            await wait_until(lambda: player.sent.total > 0, 5.0)
            with other.liveliness().declare_token("mk/show/alive"):
                for refused in (task, player.refuse_live_daemons()):
                    with pytest.raises(MkError, match="alive as show"):
                        await refused


@asynccontextmanager
async def asked(steps, *, first=None, stays=False):
    """A player that has put some values, pauses and answers; with its selection, and a client that asks it."""
    async with a_player(source=RecordedSamples(STICKS, first=first), is_paused=True) as (player, selection, endpoint):
        playing = asyncio.create_task(player.play(stays=stays))
        for _ in range(steps):
            player.adjust(lambda pace, now: pace.step(now))
        await wait_until(lambda: player.sent.total == steps)
        with player.answering():
            async with connect("show", endpoint) as uav:
                yield player, selection, uav
        player.stop()
        await playing


async def test_a_recording_that_plays_answers_as_the_vehicle_did():
    put = list(samples())
    put = put[: len(put) // 2]
    async with asked(len(put)) as (_, _, uav):
        assert await uav.absence() is None
        status = await uav.status()
        last = {entry.suffix: entry for entry in put}
        assert set(status.samples) <= set(last)
        assert status.link is not None
        for suffix, sample in status.samples.items():
            fields = msgpack.unpackb(last[suffix].payload)
            assert {name: value for name, value in sample.fields.items() if name != "age"} == fields
            assert sample.age == pytest.approx(put[-1].received - last[suffix].stamp.monotonic, abs=1e-3)
        assert await uav.schema("Attitude.v1") is not None
        with pytest.raises(CommandRejectedError) as refusal:
            await uav.release("stop")
        assert refusal.value.token == Token.RECORDING
        assert "recording plays" in refusal.value.reason


async def test_another_place_is_known_as_if_it_had_been_played_up_to_there():
    recorded = list(samples())
    async with asked(0, stays=True) as (player, selection, uav):
        await wait_until(lambda: player.status().starts == 1)
        for starts, share in ((2, 0.6), (3, 0.2), (4, 1.0)):
            place = share * player.status().length
            player.seek(place)
            await wait_until(lambda starts=starts: player.status().starts == starts)
            status, now = player.status(), selection.first + place
            assert (status.state, status.place) == (PlayState.PAUSED, pytest.approx(place))
            times = {entry: entry.base.file_time(entry.received) / 1e9 for entry in recorded}
            before = {entry.suffix: entry for entry in recorded if times[entry] < now - 2e-6}
            known = await uav.get_all("**")
            assert known.keys() - {"schema"} >= before.keys()
            for suffix, entry in before.items():
                assert known[suffix].fields["stamp"] == msgpack.unpackb(entry.payload)["stamp"], suffix
            past = await uav.get_past("state/attitude", 2.0)
            wanted = [one for one in recorded if one.suffix == "state/attitude"]
            wanted = [one for one in wanted if now - 2.0 - 2e-6 <= times[one] <= now + 2e-6]
            latest = [before[suffix] for suffix in ("state/attitude",) if suffix in before]
            assert [sample.fields["stamp"] for sample in past] == [
                msgpack.unpackb(one.payload)["stamp"] for one in wanted or latest
            ]
        whole = await uav.get_past("state/attitude", 1e9, 1e9)
        assert len(whole) == sum(one.suffix == "state/attitude" for one in recorded)
    assert player.was_sought


async def test_at_the_end_a_viewer_can_go_back():
    async with a_player(speed=1000.0) as (player, selection, _):
        playing = asyncio.create_task(player.play(stays=True))
        await wait_until(lambda: player.status().state is PlayState.ENDED)
        assert (player.sent.total, player.missing) == (selection.total, {})
        player.seek(player.status().length - 1e-3)
        await wait_until(lambda: player.status().starts == 2 and player.status().state is PlayState.ENDED)
        assert selection.total < player.sent.total < 1.1 * selection.total
        player.stop()
        await playing


async def test_who_asks_is_an_audience_too_and_a_player_that_waits_can_be_stopped():
    async with a_player() as (player, _, _):
        waiting = asyncio.create_task(player.wait_for_subscribers())
        await asyncio.sleep(0)
        player.stop()
        await waiting
        await player.play()
        assert player.sent.total == 0
    async with a_player() as (player, _, endpoint):
        with player.answering():
            waiting = asyncio.create_task(player.wait_for_subscribers())
            await asyncio.sleep(0)
            assert player.status().state is PlayState.WAITING
            async with connect("show", endpoint) as uav:
                await uav.get_all("state/*")
                await waiting


def test_days_of_silence_are_told_and_not_waited_for():
    def entries():
        for number, days in enumerate((0, 0, 9, 9)):
            one = sample(number)
            yield one._replace(received=one.received + days * 24 * 3600.0)

    with pytest.raises(
        MkError, match=r"nothing was recorded for 216 hours .* --to 2025-10-09T\S+Z, .* --from 2025-10-18T"
    ):
        PlaySelection.of(Listed(entries), None)


async def test_what_was_recorded_before_the_beginning_is_known():
    recorded = list(samples())
    third = recorded[-3].base.file_time(recorded[-3].received)
    async with asked(1, first=third) as (_, _, uav):
        assert set(await uav.get_all("**")) >= {entry.suffix for entry in recorded[:-2]}
