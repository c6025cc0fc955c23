"""The pictures of every vehicle at an endpoint, kept true by what they publish; and the few things a page may ask."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Final

from mkdaemon.client import Sample, Vehicle
from mkdaemon.client.fleet import Fleet, Sighting
from mkdaemon.errors import MkError, ProtocolError
from mkdaemon.telemetry.control import ReleaseOutcome
from mkdaemon.telemetry.play import PlayAction, PlayStatus
from mkdaemon.view.page.picture import Picture

WATCHED: Final = (
    *("state/*", "link/state", "link/health", "control/*", "vision/*/*"),
    *("event/*", "health", "record/status"),
)
"""What is looked at: nothing of the line's frames, which are most of what is published."""
BACKLOG: Final = 4096
"""Values that may wait while this program is busy."""
REASON: Final = "asked for in mkctl view"
_RELEASED: Final = {
    ReleaseOutcome.CONFIRMED: "released, and the FlightCtrl confirmed it",
    ReleaseOutcome.NOT_OBSERVABLE: "released; a confirmation cannot come this way",
    ReleaseOutcome.UNCONFIRMED: "released, but NOT confirmed: the line is silenced until the FlightCtrl lets go",
    ReleaseOutcome.NOT_SENT: "NOT sent, the line is down; it is the first thing sent when the line is back",
}


@dataclass(slots=True)
class _Exhibit:
    """One vehicle: its picture, its client, and what keeps the picture true."""

    picture: Picture
    client: Vehicle
    sightings: set[Sighting]
    task: asyncio.Task[None] | None = None


class Gallery:
    """Everybody at one endpoint.

    Attributes:
        first: vehicle to show first.
    """

    def __init__(self, fleet: Fleet, first: str) -> None:
        """Know nobody yet.

        Args:
            fleet: who is there.
            first: vehicle to show first.
        """
        self.first = first
        self._fleet = fleet
        self._exhibits: dict[str, _Exhibit] = {}
        self._loop = asyncio.get_running_loop()
        self._ended: list[asyncio.Task[None]] = []

    @asynccontextmanager
    async def open(self) -> AsyncIterator[None]:
        """Follow everybody while the context lasts."""
        try:
            async with self._fleet.watch(self._changed, self._played):
                yield
        finally:
            tasks = [exhibit.task for exhibit in self._exhibits.values() if exhibit.task is not None]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, *self._ended, return_exceptions=True)

    @property
    def pictures(self) -> dict[str, Picture]:
        """Every vehicle that is or was there: those under `mk/` by their name, others as `replay/<name>`."""
        return {word: exhibit.picture for word, exhibit in self._exhibits.items()}

    def choose(self, wanted: str) -> Picture | None:
        """The picture of a vehicle; of one that is there where none is wanted; None while nobody is."""
        pictures = self.pictures
        if wanted:
            return pictures.get(wanted)
        ranked = sorted(pictures, key=lambda word: (not pictures[word].is_here, word != self.first, word))
        return pictures[ranked[0]] if ranked else None

    async def abort(self, word: str) -> str:
        """Stop what a vehicle flies; what to tell.

        Raises:
            MkError: refused, or nobody is there.
        """
        await self._live(word).abort(REASON)
        return "aborted: the aircraft holds, or is level"

    async def release(self, word: str) -> str:
        """Let go of a vehicle; what to tell.

        Raises:
            MkError: refused, or nobody is there.
        """
        report = await self._live(word).release(REASON)
        return _RELEASED[report.status]

    async def play(self, word: str, action: PlayAction, speed: float | None) -> str:
        """Pause a recording, or play it at another speed; what to tell.

        Raises:
            MkError: nobody plays it.
        """
        exhibit = self._exhibits.get(word)
        if exhibit is None or not exhibit.picture.is_played:
            raise MkError(f"{word} is no recording that is played")
        status = await self._fleet.control(exhibit.client.vehicle, action, speed)
        exhibit.picture.take_play(status, self._loop.time())
        return f"{status.state}, {status.speed:g} times"

    def _live(self, word: str) -> Vehicle:
        exhibit = self._exhibits.get(word)
        if exhibit is None or not exhibit.picture.is_here:
            raise MkError(f"no daemon speaks for {word}")
        if exhibit.picture.is_played:
            raise MkError(f"{word} is a recording: it takes no commands")
        return exhibit.client

    def _changed(self) -> None:
        """Somebody came or went."""
        for sighting in self._fleet.here:
            word = sighting.name if sighting.root == "mk" else f"{sighting.root}/{sighting.name}"
            exhibit = self._exhibits.get(word)
            if exhibit is None:
                picture = Picture(word, is_played=sighting.is_played)
                exhibit = self._exhibits[word] = _Exhibit(picture, self._fleet.client(sighting), set())
            exhibit.sightings.add(sighting)
        for word, exhibit in self._exhibits.items():
            exhibit.sightings &= self._fleet.here
            picture = exhibit.picture
            was_here, picture.is_here = picture.is_here and exhibit.task is not None, bool(exhibit.sightings)
            if picture.is_here:
                picture.is_played = all(sighting.is_played for sighting in exhibit.sightings)
            if picture.is_here and not was_here:
                if exhibit.task is not None:
                    self._ended.append(exhibit.task)
                    exhibit.task.cancel()
                exhibit.task = self._loop.create_task(self._follow(exhibit), name=f"picture of {word}")

    def _played(self, name: str, status: PlayStatus) -> None:
        """A player says how far it is."""
        for exhibit in self._exhibits.values():
            if exhibit.client.vehicle == name and exhibit.picture.is_played:
                exhibit.picture.take_play(status, self._loop.time())

    async def _follow(self, exhibit: _Exhibit) -> None:
        """Keep one picture true."""
        client, picture = exhibit.client, exhibit.picture
        async with client.watch(*WATCHED, backlog=BACKLOG, are_known=True) as samples:
            last: list[Sample] = []
            for pattern in WATCHED:
                with suppress(MkError):  # a daemon that is busy: what it publishes comes all the same
                    last += (await client.get_all(pattern)).values()
            last.sort(key=lambda sample: sample.fields.get("stamp", {}).get("monotonic", 0.0))
            for sample in last:
                self._take(picture, sample)
            async for sample in samples:
                self._take(picture, sample)

    def _take(self, picture: Picture, sample: Sample) -> None:
        # What another version publishes differently stays unknown here, as it is.
        with suppress(ProtocolError):
            picture.take(sample.suffix, sample.value, self._loop.time(), sample.age)
