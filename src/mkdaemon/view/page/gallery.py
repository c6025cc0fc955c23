"""The pictures of every vehicle at an endpoint, kept true by what they publish; and the few things a page may ask."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Final

from mkdaemon.client import Sample, Vehicle
from mkdaemon.client.fleet import Fleet, FleetSighting
from mkdaemon.errors import MkError
from mkdaemon.telemetry.play import PlayAction, PlayStatus
from mkdaemon.view.page.overview import overview_of
from mkdaemon.view.page.picture import VehiclePicture

CURVES: Final = 30.0
"""Of what is drawn over time [s]."""
TRAIL: Final = 150.0
"""Of the trail [s]."""
EVER: Final = 1e9
"""Longer than any recording [s]."""
WATCHED: Final = {
    **dict.fromkeys(("state/*", "link/health", "control/error", "control/output"), CURVES),
    **dict.fromkeys(("control/estimate", "vision/*/pose"), TRAIL),
    "event/*": EVER,
    **dict.fromkeys(("link/state", "control/status", "control/fence", "control/path", "health", "record/status"), 0.0),
    **{f"vision/*/{what}": 0.0 for what in ("image", "setup", "stats", "tags", "refused")},
}
"""What is looked at, nothing of the line's frames, which are most of what is published; and how much of what came
before is wanted where a recording is played [s], for a picture like that of someone who looked all the time."""
BACKLOG: Final = 4096
"""Values that may wait while this program is busy."""
AT_ONCE: Final = 200
"""Values that are taken before anything else is done."""
REASON: Final = "asked for in mkctl view"


@dataclass(slots=True)
class _Exhibit:
    """One vehicle: its picture, its client, and what keeps the picture true."""

    picture: VehiclePicture
    client: Vehicle
    sightings: set[FleetSighting]
    task: asyncio.Task[None] | None = None


class Gallery:
    """Every vehicle at one endpoint.

    Attributes:
        first: vehicle to show first.
    """

    def __init__(self, fleet: Fleet, first: str) -> None:
        """Start without a vehicle.

        Args:
            fleet: who is there.
            first: vehicle to show first.
        """
        self.first = first
        self._fleet = fleet
        self._exhibits: dict[str, _Exhibit] = {}
        self._loop = asyncio.get_running_loop()
        self._ended: list[asyncio.Task[None]] = []
        self._is_open = False

    @asynccontextmanager
    async def open(self) -> AsyncIterator[None]:
        """Follow every vehicle while the context lasts."""
        self._is_open = True
        try:
            async with self._fleet.watch(self._changed, self._played):
                yield
        finally:
            self._is_open = False  # what was heard just before may still be on its way through the loop
            tasks = [exhibit.task for exhibit in self._exhibits.values() if exhibit.task is not None]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, *self._ended, return_exceptions=True)

    @property
    def pictures(self) -> dict[str, VehiclePicture]:
        """Every vehicle that is or was there: those under `mk/` by their name, others as `replay/<name>`."""
        return {word: exhibit.picture for word, exhibit in self._exhibits.items()}

    def choose(self, wanted: str) -> VehiclePicture | None:
        """The picture of a vehicle, or of any present one if `wanted` is empty; None if no vehicle is present."""
        pictures = self.pictures
        if wanted:
            return pictures.get(wanted)
        ranked = sorted(pictures, key=lambda word: (not pictures[word].is_here, word != self.first, word))
        return pictures[ranked[0]] if ranked else None

    async def abort(self, word: str) -> str:
        """Stop what a vehicle flies; what to tell.

        Raises:
            MkError: refused, or the vehicle is not present.
        """
        await self._live(word).abort(REASON)
        return "aborted: the aircraft holds, or is level"

    async def release(self, word: str) -> str:
        """Release a vehicle; return the text to show.

        Raises:
            MkError: refused, or the vehicle is not present.
        """
        report = await self._live(word).release(REASON)
        return report.status.words

    async def play(self, word: str, action: PlayAction, **fields: float) -> str:
        """Pause a recording, play it at another speed or go on at another place; what to tell.

        Args:
            word: name of the picture.
            action: what to do.
            fields: others of a `PlayControl`.

        Raises:
            MkError: no player plays it.
        """
        exhibit = self._exhibits.get(word)
        if exhibit is None or not exhibit.picture.is_played:
            raise MkError(f"{word} is no recording that is played")
        status = await self._fleet.control(exhibit.client.vehicle, action, **fields)
        return f"{status.state}, {status.speed:g} times"

    def _live(self, word: str) -> Vehicle:
        exhibit = self._exhibits.get(word)
        if exhibit is None or not exhibit.picture.is_here:
            raise MkError(f"no daemon speaks for {word}")
        if exhibit.picture.is_played:
            raise MkError(f"{word} is a recording: it takes no commands")
        return exhibit.client

    def _changed(self) -> None:
        """Update the vehicles that are present."""
        for sighting in self._fleet.here:
            word = sighting.name if sighting.root == "mk" else f"{sighting.root}/{sighting.name}"
            exhibit = self._exhibits.get(word)
            if exhibit is None:
                picture = VehiclePicture(word, is_played=sighting.is_played)
                exhibit = self._exhibits[word] = _Exhibit(picture, self._fleet.client(sighting), set())
            exhibit.sightings.add(sighting)
        for exhibit in self._exhibits.values():
            exhibit.sightings &= self._fleet.here
            picture = exhibit.picture
            was_here, picture.is_here = picture.is_here and exhibit.task is not None, bool(exhibit.sightings)
            if picture.is_here:
                picture.is_played = all(sighting.is_played for sighting in exhibit.sightings)
            if picture.is_here and not was_here:
                picture.flight = None
                self._begin(exhibit)

    def _played(self, name: str, status: PlayStatus) -> None:
        """A player says how far it is; a recording that was moved to another time is read again from there."""
        for exhibit in self._exhibits.values():
            is_it = exhibit.client.vehicle == name and exhibit.picture.is_played
            if is_it and exhibit.picture.take_play(status, self._loop.time()):
                self._begin(exhibit)

    def _begin(self, exhibit: _Exhibit) -> None:
        """Follow a vehicle, from the beginning where it is followed already."""
        if not self._is_open:
            return
        if exhibit.task is not None:
            self._ended = [task for task in self._ended if not task.done()] + [exhibit.task]
            exhibit.task.cancel()
        exhibit.task = self._loop.create_task(self._follow(exhibit), name=f"picture of {exhibit.picture.name}")

    async def _follow(self, exhibit: _Exhibit) -> None:
        """Keep one picture true."""
        client, picture = exhibit.client, exhibit.picture
        async with client.watch(*WATCHED, backlog=BACKLOG, are_known=True) as samples, asyncio.TaskGroup() as beside:
            last: list[Sample] = []
            for pattern, past in WATCHED.items():
                with suppress(MkError):  # a daemon that is busy: what it publishes comes all the same
                    last += await client.get_past(pattern, past)
            newest: dict[str, tuple[str, float]] = {}
            for number, sample in enumerate(sorted(last, key=lambda sample: _moment(sample)[1])):
                newest[sample.suffix] = _moment(sample)
                self._take(picture, sample)
                if number % AT_ONCE == 0:
                    await asyncio.sleep(0)
            if picture.is_played and picture.flight is None:
                beside.create_task(self._overlook(exhibit), name="overview")
            async for sample in samples:
                boot, at = _moment(sample)
                known_boot, known = newest.get(sample.suffix, ("", 0.0))
                if boot != known_boot or at > known:  # else it came while the others were asked for
                    self._take(picture, sample)

    async def _overlook(self, exhibit: _Exhibit) -> None:
        """Learn what happens in the whole recording."""
        found: list[Sample] = []
        for pattern in ("control/status", "event/*"):
            with suppress(MkError):
                found += await exhibit.client.get_past(pattern, EVER, EVER)
        exhibit.picture.flight = overview_of(sample.known for sample in found)

    def _take(self, picture: VehiclePicture, sample: Sample) -> None:
        picture.take(sample.suffix, sample.known, self._loop.time(), sample.age)


def _moment(sample: Sample) -> tuple[str, float]:
    """Name of the clock and time of a stamp [s]."""
    stamp = sample.fields.get("stamp")
    boot, at = (stamp.get("boot", ""), stamp.get("monotonic", 0.0)) if isinstance(stamp, dict) else ("", 0.0)
    return str(boot), float(at) if isinstance(at, int | float) else 0.0
