"""One vehicle before its viewers: its channels, who looks at them, and what they are given.

A channel costs nothing until a viewer subscribes to it. Then the gateway subscribes to its keys on the bus. A new
viewer gets the last values at once; viewers that have them do not get them twice.
"""

from __future__ import annotations

import asyncio
import math
import threading
from collections.abc import Callable, Collection
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Final

import structlog
from foxglove import Channel, Context

from mkdaemon.client import Sample, Vehicle
from mkdaemon.errors import MkError, ProtocolError
from mkdaemon.gateways.faults import Faults
from mkdaemon.gateways.foxglove.names import LATEST, Names
from mkdaemon.gateways.foxglove.topics import Conversion, FoxgloveTopic, json_message, json_topic, topics_of
from mkdaemon.gateways.keys import matches
from mkdaemon.stamp import nanoseconds
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.record import BusCounts

LOOK_PERIOD: Final = 2.0
"""Interval between searches for new keys while a viewer is subscribed to any channel [s]."""
FOUND: Final = ("vision/*/setup", "vision/*/stats", "rx/*/*", "tx/*/*")
"""Where keys are looked for that not every vehicle has."""
_LISTENED: Final = 512
"""Keys of which something is remembered, those of the newest values; strangers can put to any."""
LEAP: Final = 1.0
"""A key's stamp that goes back by more is of a recording that goes on at another place, or of another boot [s]."""

_log = structlog.get_logger(__name__)


class Feed:
    """The subscriptions of one vehicle: what viewers want of it comes once, and nothing else comes."""

    def __init__(self, take: Callable[[Sample], None]) -> None:
        """Subscribe to nothing.

        Args:
            take: called with each sample, on Zenoh's thread.
        """
        self._take = take
        self._client: Vehicle | None = None
        self._subscribed: dict[str, ExitStack] = {}

    def follow(self, client: Vehicle) -> None:
        """Go on with another client of the vehicle."""
        wanted = set(self._subscribed)
        self.want(())
        self._client = client
        self.want(wanted)

    def want(self, patterns: Collection[str]) -> None:
        """Be subscribed to these patterns and no others; they wait until a daemon speaks for the vehicle."""
        widest = {one for one in patterns if not any(other != one and matches(other, one) for other in patterns)}
        for pattern in widest - self._subscribed.keys():  # before others end: no value falls between two subscriptions
            self._subscribed[pattern] = ExitStack()
            if self._client is not None:
                self._subscribed[pattern].enter_context(self._client.each(pattern, self._take))
        for pattern in self._subscribed.keys() - widest:
            self._subscribed.pop(pattern).close()


@dataclass(slots=True)
class Line:
    """One channel.

    Attributes:
        channel: as it is advertised.
        topic: what it is made of.
        convert: makes its messages; None for JSON.
        clients: who is subscribed.
        given: time of the last value of each key that they were given [s].
    """

    channel: Channel
    topic: FoxgloveTopic
    convert: Conversion | None
    clients: set[int] = field(default_factory=set)
    given: dict[str, float] = field(default_factory=dict)


class Exhibit:
    """One vehicle.

    Attributes:
        lines: every channel, by its id.
        faults: each ended the one message of a value that met it.
    """

    def __init__(self, context: Context, names: Names, clock: Callable[[int], None]) -> None:
        """Advertise what every vehicle has.

        Args:
            context: where channels are made.
            names: of the vehicle.
            clock: called with the time of every value that arrives [ns; Unix time].
        """
        self.lines: dict[int, Line] = {}
        self.faults = Faults("foxglove")
        self._context, self._names, self._clock = context, names, clock
        self._client: Vehicle | None = None
        self._listeners = lru_cache(_LISTENED)(self._listening)
        self._lock = threading.Lock()  # values come on Zenoh's thread, viewers on the loop
        self._feed = Feed(self._take)
        self._known: set[str] = set()
        self._cameras: set[str] = set()
        self._newest: dict[str, tuple[str, float]] = {}
        self._is_watched = asyncio.Event()
        self._looking: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        for topic in topics_of():
            self._add(topic)

    # -- channels -------------------------------------------------------------------------------------------------

    def _add(self, topic: FoxgloveTopic) -> None:
        if topic.name in self._known:
            return
        self._known.add(topic.name)
        name, names = self._names.topic(topic.name), self._names
        channel = Channel(name, message_encoding=topic.encoding, schema=topic.schema(), context=self._context)
        with self._lock:
            self.lines[channel.id()] = Line(channel, topic, topic.conversion(names))

    def _add_camera(self, camera: str) -> None:
        if camera not in self._cameras:
            self._cameras.add(camera)
            for topic in topics_of(camera):
                self._add(topic)

    # -- who looks ------------------------------------------------------------------------------------------------

    def subscribed(self, channel: int, client: int) -> None:
        """A viewer looks at a channel."""
        line = self.lines[channel]
        with self._lock:
            is_first = not line.clients
            line.clients.add(client)
            if is_first:
                self._forget(line)
        self._want()
        self._start(self._show_last(line, client, is_first=is_first), f"last values of {line.channel.topic()}")

    def unsubscribed(self, channel: int, client: int) -> None:
        """A viewer looks at a channel no more."""
        with self._lock:
            self.lines[channel].clients.discard(client)
        self._want()

    def follow(self, client: Vehicle, *, is_played: bool = False) -> None:
        """Show the vehicle by this client from now on.

        Args:
            client: of the daemon, or of the player, that speaks for it.
            is_played: a recording; it is not queried before a viewer subscribes, because the query would start it.
        """
        self._client = client
        with self._lock:
            self._restart()
        self._feed.follow(client)
        if self._looking is not None:
            self._looking.cancel()
        self._looking = self._start(self._look(client, is_played=is_played), "look for keys")
        for line in self.lines.values():
            for viewer in line.clients:
                self._start(self._show_last(line, viewer, is_first=True), f"last values of {line.channel.topic()}")

    async def close(self) -> None:
        """End everything."""
        self._feed.want(())
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for line in self.lines.values():
            line.channel.close()

    def _want(self) -> None:
        """Subscribe on the bus to the keys of the channels in use."""
        with self._lock:
            self._listeners.cache_clear()
            wanted = {key for line in self.lines.values() if line.clients for key in line.topic.keys}
        self._feed.want(wanted)  # without the lock: a callback that waits for it may have to end first
        (self._is_watched.set if wanted else self._is_watched.clear)()

    def _listening(self, suffix: str) -> list[Line]:
        """Channels in use that are made of a key; the values themselves first, which take the least time."""
        found = (line for line in self.lines.values() if line.clients and line.topic.takes(suffix))
        return sorted(found, key=lambda line: line.convert is not None)

    def _start(self, work: Any, name: str) -> asyncio.Task[None]:
        task: asyncio.Task[None] = asyncio.create_task(work, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def _look(self, client: Vehicle, *, is_played: bool) -> None:
        """Search for keys that not every vehicle has: until some are found, and while a viewer is subscribed.

        A daemon that has just started has none yet, and a viewer may want nothing else.
        """
        known = len(self._known)
        if is_played:
            await self._is_watched.wait()
        while True:
            with suppress(MkError):  # a daemon that is busy is asked again
                for pattern in FOUND if is_played else await self._unknown(client):
                    for suffix, sample in (await client.get_all(pattern)).items():
                        head, name, *_ = suffix.split("/")
                        if head == "vision":
                            self._add_camera(name)
                        else:
                            self._add(json_topic(suffix, sample.schema))
            await asyncio.sleep(LOOK_PERIOD)
            if len(self._known) > known:
                await self._is_watched.wait()

    async def _unknown(self, client: Vehicle) -> Collection[str]:
        """What the last values are asked for of: keys that the daemon has put and that are no channel yet.

        Asked for every frame of the boards, daemon and gateway would be busy for some milliseconds, again and again.
        """
        counted = await client.get("bus/counts")
        if counted is None or not isinstance(counts := counted.known, BusCounts):
            return FOUND
        found = (key for key in counts.counts if any(matches(pattern, key) for pattern in FOUND))
        return [key for key in found if f"/{key}" not in self._known and key.split("/")[1] not in self._cameras]

    # -- what they are given --------------------------------------------------------------------------------------

    def _take(self, sample: Sample) -> None:
        """A value comes, on Zenoh's thread."""
        boot, at, wall = _moment(sample)
        with self._lock:
            known_boot, known = self._newest.get(sample.suffix, (boot, at))
            if boot != known_boot or at < known - LEAP:
                self._restart()
            _remember(self._newest, sample.suffix, (boot, at))
            self._clock(wall)
            for line in self._listeners(sample.suffix):
                _remember(line.given, sample.suffix, at)
                self._show(line, line.convert, sample, wall)

    def _show(
        self, line: Line, convert: Conversion | None, sample: Sample, wall: int, client: int | None = None
    ) -> None:
        """Send a value to every viewer of a channel, or to one of them."""
        try:
            message = _message(convert, sample)
            if message is not None:
                line.channel.log(message, log_time=wall, sink_id=client)
        except Exception as error:  # noqa: BLE001  # a stranger may put numbers that no message can have
            self.faults.note(line.channel.topic(), error)

    def _restart(self) -> None:
        """Forget all values: a recording was moved to another time, or another source publishes the vehicle."""
        self._newest.clear()
        for line in self.lines.values():
            self._forget(line)

    def _forget(self, line: Line) -> None:
        """Forget which values the viewers have."""
        line.given.clear()
        line.convert = line.topic.conversion(self._names)

    async def _show_last(self, line: Line, client: int, *, is_first: bool) -> None:
        """Give the last values to one viewer, from the oldest on.

        Args:
            line: the channel.
            client: the viewer.
            is_first: the channel has no other viewer, so its conversion learns from these values too.
        """
        bus, samples = self._client, []
        if bus is None:
            return
        for key in line.topic.keys:
            with suppress(MkError):  # a daemon that is busy: what it publishes comes all the same
                samples += list((await bus.get_all(key)).values())
        with self._lock:
            # Others have been given what came before.
            convert = line.convert if is_first else line.topic.conversion(self._names)
            for sample in sorted(samples, key=lambda one: _moment(one)[1]):
                _, at, wall = _moment(sample)
                if is_first and at <= line.given.get(sample.suffix, float("-inf")):
                    continue  # it came while the others were asked for
                if client in line.clients:
                    self._show(line, convert, sample, wall, client)


def _remember(kept: dict[str, Any], key: str, value: Any) -> None:
    """Keep something of a key, and of no more than `_LISTENED` keys."""
    kept.pop(key, None)
    kept[key] = value
    if len(kept) > _LISTENED:
        del kept[next(iter(kept))]


def _moment(sample: Sample) -> tuple[str, float, int]:
    """Name of the clock, time [s], and wall time [ns] of a stamp; zeros where there is none."""
    stamp = sample.fields.get("stamp")
    if not isinstance(stamp, dict):
        return "", 0.0, 0
    wall, monotonic = (_finite(stamp.get(name)) for name in ("wall", "monotonic"))
    return str(stamp.get("boot", "")), monotonic, min(max(nanoseconds(wall), 0), LATEST)


def _finite(number: object) -> float:
    """A number of a stamp; zero for what is none, as strangers may put."""
    return float(number) if isinstance(number, int | float) and math.isfinite(number) else 0.0


def _message(convert: Conversion | None, sample: Sample) -> bytes | None:
    """The message that a sample makes; None for none, and where another version publishes it differently."""
    if convert is None:
        return json_message(sample.fields)
    try:
        value = sample.value
    except ProtocolError as error:
        _log.debug("left out", key=sample.suffix, why=str(error))
        return None
    return convert(sample.suffix, value) if isinstance(value, Stamped) else None
