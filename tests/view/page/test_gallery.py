"""Who is there, what is kept of each, and a recording that is paused from the page."""

from __future__ import annotations

import asyncio
import time
from contextlib import asynccontextmanager
from fnmatch import fnmatchcase

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.client import Vehicle
from mkdaemon.client.fleet import Fleet, FleetSighting
from mkdaemon.client.player import Player, PlayPace, open_player_session
from mkdaemon.client.playselection import PlaySelection, RecordedSamples
from mkdaemon.client.samples import Sample, read_payload
from mkdaemon.errors import MkError
from mkdaemon.telemetry.play import PlayAction, PlayState, PlayStatus
from mkdaemon.view.page.gallery import WATCHED, Gallery
from mkdaemon.view.page.picture import VehiclePicture
from tests import samples
from tests.places import DATA
from tests.values import made

STICKS = DATA / "recordings" / "fc_sticks.mcap"


async def test_vehicles_come_and_go_and_publish():
    async with open_player_session(connect=(), listen=None, alone=True) as session:
        gallery = Gallery(Fleet(Vehicle(session, "two", "here")), "two")
        async with gallery.open():
            assert gallery.choose("") is None
            with session.liveliness().declare_token("mk/one/alive"):
                with session.liveliness().declare_token("mk/two/alive"):
                    await wait_until(lambda: set(gallery.pictures) == {"one", "two"})
                    first = gallery.choose("")
                    assert first is not None and first.name == "two"
                    value = samples.attitude(1000.0)

                    def is_shown() -> bool:
                        session.put("mk/two/state/attitude", encode(value), encoding=encoding_of(type(value)))
                        lines = first.show(time.monotonic())["lines"]
                        return "roll +5.7°" in next(line["text"] for line in lines if line["id"] == "attitude")

                    await wait_until(is_shown)
                    with pytest.raises(MkError):
                        await gallery.play("two", PlayAction.PAUSE)
                await wait_until(lambda: not first.is_here)
                remaining = gallery.choose("")
                assert remaining is not None and remaining.name == "one"
                with pytest.raises(MkError, match="no daemon speaks for two"):
                    await gallery.release("two")


@asynccontextmanager
async def played(name=None, **pace):
    """A player of a recording that answers, its selection, a fleet that meets it, and the name it has there."""
    async with open_player_session(connect=(), listen=None, alone=True) as session:
        selection = PlaySelection.of(RecordedSamples(STICKS), name)
        player = Player(session, selection, PlayPace(1.0, selection.first, time.monotonic(), **pace), STICKS.name)
        with player.answering():
            (seen,) = selection.names
            yield player, selection, Fleet(Vehicle(session, seen, "here")), seen


async def test_a_recording_is_paused_and_takes_no_commands():
    async with played() as (player, _, fleet, name):
        gallery = Gallery(fleet, name)
        async with gallery.open():
            word = f"replay/{name}"
            await wait_until(lambda: word in gallery.pictures)
            assert gallery.pictures[word].is_played
            for _ in range(2):
                assert await gallery.play(word, PlayAction.PAUSE) == "paused, 1 times"
            assert player.pace.is_paused
            assert await gallery.play(word, PlayAction.SPEED, speed=4.0) == "paused, 4 times"
            assert (await gallery.play(word, PlayAction.GO_ON)).endswith("4 times")
            assert not player.pace.is_paused
            assert (await gallery.play(word, PlayAction.STEP)).startswith(PlayState.PAUSED)
            with pytest.raises(MkError, match="speed"):
                await gallery.play(word, PlayAction.SPEED, speed=1e9)
            for button in (gallery.abort, gallery.release):
                with pytest.raises(MkError, match="takes no commands"):
                    await button(word)


class Heard:
    """A fleet of one, of which something is still on its way when nobody listens any more."""

    here = frozenset({FleetSighting("one", "mk", is_played=False)})

    def client(self, sighting):
        return Vehicle(self.session, sighting.name, "here")

    @asynccontextmanager
    async def watch(self, changed, played):
        self.changed, self.played = changed, played
        yield

    async def control(self, name, action, **fields):
        return self.answer


async def test_what_is_heard_after_the_end_begins_nothing():
    fleet = Heard()
    async with open_player_session(connect=(), listen=None, alone=True) as fleet.session:
        async with Gallery(fleet, "one").open():
            pass
        fleet.changed()
        assert not [task for task in asyncio.all_tasks() if task.get_name().startswith("picture of")]


async def test_an_answer_that_overtakes_what_was_published_forgets_nothing():
    fleet = Heard()
    fleet.here = frozenset({FleetSighting("one", "replay", is_played=True)})
    async with open_player_session(connect=(), listen=None, alone=True) as fleet.session:
        gallery = Gallery(fleet, "one")
        async with gallery.open():
            fleet.changed()
            picture = gallery.pictures["replay/one"]
            begun = made(PlayStatus, state=PlayState.PLAYING, starts=1)
            fleet.answer = begun.model_copy(update={"starts": 2})
            fleet.played("one", begun)
            await gallery.play("replay/one", PlayAction.SEEK, place=5.0)
            fleet.played("one", begun)  # on its way since before
            fleet.played("one", fleet.answer)
            assert picture.show(0.0)["restarts"] == 1


async def test_at_another_place_a_picture_is_as_if_it_had_been_looked_at_all_the_time():
    async with played(is_paused=True) as (player, selection, fleet, name):
        gallery = Gallery(fleet, name)
        playing = asyncio.create_task(player.play(stays=True))
        async with gallery.open():
            word, length = f"replay/{name}", selection.last - selection.first
            await wait_until(lambda: word in gallery.pictures and gallery.pictures[word].flight is not None)
            picture = gallery.pictures[word]
            for place in (0.9 * length, 0.4 * length):
                assert (await gallery.play(word, PlayAction.SEEK, place=place)).startswith("paused")
                looked = watched_until(selection, selection.first + place)
                assert any(curves(looked).values())
                await wait_until(
                    lambda looked=looked: (curves(picture), lines(picture)) == (curves(looked), lines(looked))
                )
                assert {line.text for line in picture.events} == {line.text for line in looked.events}
            assert picture.flight.marks
        player.stop()
        await playing


def watched_until(selection: PlaySelection, end: float) -> VehiclePicture:
    """The picture of a recording that was looked at from its beginning to a time [s; Unix time]."""
    picture = VehiclePicture("looked", is_played=True)
    for at, key, entry in selection.played(selection.first):
        suffix = key.whole.split("/", 2)[2]
        if at < end and any(fnmatchcase(suffix, pattern) for pattern in WATCHED):
            picture.take(suffix, Sample(suffix, read_payload(entry.encoding, entry.payload), entry.encoding).value, at)
    return picture


def curves(picture: VehiclePicture) -> dict[str, list[tuple[float | None, ...]]]:
    return {word: series.since(0) for word, series in picture.series.items()}


def lines(picture: VehiclePicture) -> dict[str, str]:
    return {line["id"]: line["text"] for line in picture.show(time.monotonic())["lines"]}
