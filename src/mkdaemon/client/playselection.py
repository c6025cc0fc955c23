"""What of a recording is played, and under which keys: never under one that commands.

A `PlayKey` can only be made of a key that carries published values. Setpoints, requests, liveliness tokens and the pads
of other machines have none, and neither has a key with a wildcard, which would reach other keys too. So nothing that
could move an aircraft or reach a port can leave a player, whatever is in the file.
"""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import accumulate, islice
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.bus.keys import Use, find
from mkdaemon.bus.names import REPLAY, ROOT
from mkdaemon.config.names import VEHICLE_NAME
from mkdaemon.errors import MkError
from mkdaemon.record.entry import Entry, EntryKind
from mkdaemon.record.layout import ChannelFacts
from mkdaemon.record.reader import Recording, matches_any
from mkdaemon.stamp import NANOSECONDS, nanoseconds

_SHOWN: Final = frozenset({Use.PUBLISHED, Use.CLIENT})
_HANDS: Final = "joy/"
"""Keys of pads, by which a program on another machine flies."""
_WILD: Final = frozenset("*$?#")
"""Characters by which a key expression of Zenoh means more than one key."""


@dataclass(frozen=True, slots=True)
class PlayKey:
    """A key that a player may put.

    Attributes:
        whole: the Zenoh key.
    """

    whole: str

    def __post_init__(self) -> None:
        """Refuse what commands.

        Raises:
            ValueError: this key does not carry published values.
        """
        suffix = shown_suffix(self.whole)
        if suffix is None:
            raise ValueError(f"{self.whole} is not a key of published values: a player cannot put it")


def shown_suffix(whole: str) -> str | None:
    """What follows `mk/<vehicle>/` or `replay/<vehicle>/` in a key of published values; None for any other key."""
    root, _, rest = whole.partition("/")
    vehicle, _, suffix = rest.partition("/")
    is_plain = root in {ROOT, REPLAY} and re.fullmatch(VEHICLE_NAME, vehicle) is not None and not _WILD & set(suffix)
    spec = find(suffix) if is_plain and not suffix.startswith(_HANDS) else None
    return suffix if spec is not None and spec.use in _SHOWN else None


def play_key(key: str, name: str | None) -> PlayKey | None:
    """The key under which a recorded one is played; None where it is not played at all.

    Args:
        key: as recorded, `mk/<vehicle>/...`.
        name: vehicle to play as; None for `replay/<vehicle>/...`.
    """
    if shown_suffix(key) is None:
        return None
    _, vehicle, suffix = key.split("/", 2)
    return PlayKey(f"{REPLAY}/{vehicle}/{suffix}" if name is None else f"{ROOT}/{name}/{suffix}")


AHEAD: Final = 256
"""Values that are read at once, before they are due."""
LONGEST_SILENCE: Final = 24 * 3600.0
"""Between two values [s]: longest wait for the next one; the times of two recordings, or of a damaged one."""
STEP: Final = 1e-5
"""Lateness is counted in steps of this [s]."""


MOST_BETWEEN: Final = 20_000
"""Values that are reported at once."""
_NEVER: Final = 1 << 64
_ROUNDED: Final = 1000
"""A time in seconds is as exact as this [ns]."""


def _time(entry: Entry) -> float:
    """When an entry was recorded [s; Unix time]."""
    return entry.base.file_time(entry.received) / NANOSECONDS


def _floor(at: float) -> int:
    """A time [s] in a file [ns], not after it."""
    return nanoseconds(at) - _ROUNDED


def _moment(at: float) -> str:
    """A time [s; Unix time] as `--from` takes it."""
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


@dataclass(slots=True)
class PlayedCounts:
    """What was put.

    Attributes:
        counts: values by key, as played.
        late: how late they were put, at their speed: values by the number of `STEP`s.
        total: how many.
    """

    counts: Counter[str] = field(default_factory=Counter)
    late: Counter[int] = field(default_factory=Counter)

    @property
    def total(self) -> int:
        """How many."""
        return self.counts.total()

    def late_below(self, share: float) -> float | None:
        """The lateness that so large a share stays below [s]; None where nothing was put."""
        counted = accumulate(sorted(self.late.items()), lambda sum_, step: (step[0], sum_[1] + step[1]))
        return next(((step + 1) * STEP for step, count in counted if count >= share * self.late.total()), None)


class Played(NamedTuple):
    """A value to be played.

    Attributes:
        at: its time [s; Unix time].
        key: to put it to.
        entry: as recorded.
    """

    at: float
    key: PlayKey
    entry: Entry


Progress = Callable[[int], None]
"""Takes how many bytes of a file have been read."""
Choice = Callable[[str], bool]
"""Chooses keys."""


class RecordedSamples:
    """The published values of a file, or of a part of it."""

    def __init__(
        self, file: Path, keys: tuple[str, ...] = (), first: int | None = None, last: int | None = None
    ) -> None:
        """Name the part.

        Args:
            file: the recording.
            keys: patterns of the keys that are wanted; none for all.
            first: time in the file of the first value [ns]; None for the beginning.
            last: of the last one; None for the end.
        """
        self._recording, self._keys = Recording(file), keys
        self._first, self._last = first or 0, last

    def times(self, progress: Progress) -> Iterator[tuple[ChannelFacts, int]]:
        """Channel and time [ns] of every value, in order; reads the whole file once.

        Raises:
            MkError: it cannot be read.
        """
        for number, (facts, at) in enumerate(self._recording.times(self._is_wanted)):
            if number % 1000 == 0:
                progress(self._recording.position)
            if self._first <= at and (self._last is None or at <= self._last):
                yield facts, at

    def entries(self, first: int, last: int | None = None, choice: Choice | None = None) -> Iterator[Entry]:
        """Values from one time of the file to another [ns], of all keys or of some, in order."""
        ends = [one for one in (last, self._last) if one is not None]
        yield from self._recording.again().entries(
            lambda facts: self._is_wanted(facts) and (choice is None or choice(facts.key)),
            first=max(first, self._first, 1),
            last=min(ends, default=None),
        )

    def latest(self, before: int) -> list[Entry]:
        """The last value of each key before a time of the file [ns], also from before the part that is played."""
        return self._recording.again().latest(self._is_wanted, before)

    def _is_wanted(self, facts: ChannelFacts) -> bool:
        return facts.kind is EntryKind.SAMPLE and matches_any(facts.key, self._keys)


@dataclass(frozen=True, slots=True)
class PlaySelection:
    """Which part of a recording is played, and as what.

    Attributes:
        counts: values by key, as played.
        keys: to put them to, by the key as recorded.
        first: time of its beginning [s; Unix time].
        last: of its end [s; Unix time].
        zero: the same as `first`, of the daemon's monotonic clock [s].
        name: vehicle to play as; None for `replay/<vehicle>/...`.
    """

    counts: Counter[str]
    keys: dict[str, PlayKey]
    first: float
    last: float
    zero: float
    name: str | None
    _source: RecordedSamples

    @classmethod
    def of(cls, source: RecordedSamples, name: str | None, progress: Progress = lambda position: None) -> PlaySelection:
        """Look through a recording once.

        Args:
            source: gives the values.
            name: vehicle to play as; None for `replay/<vehicle>/...`.
            progress: hears how many bytes of the file have been read.

        Raises:
            MkError: there is nothing to play, or days between two values.
        """
        known: dict[str, PlayKey | None] = {}
        counts: Counter[str] = Counter()
        first, last, zero = _NEVER, 0, 0.0
        for facts, at in source.times(progress):
            if facts.key not in known:
                known[facts.key] = play_key(facts.key, name)
            if known[facts.key] is None:
                continue
            if at - last > LONGEST_SILENCE * NANOSECONDS and counts:
                before, behind = last / NANOSECONDS, at / NANOSECONDS
                msg = (
                    f"nothing was recorded for {(behind - before) / 3600:.0f} hours after {_moment(before)}: play what "
                    f"is before it, with --to {_moment(before + 1)}, or behind it, with --from {_moment(behind)}"
                )
                raise MkError(msg)
            counts[facts.key] += 1
            last = max(last, at)
            if at < first:
                first, zero = at, facts.base.monotonic(at)
        if not counts:
            msg = "nothing to play: no published value in this part of the recording; `mkctl log info` shows its keys"
            raise MkError(msg)
        keys = {recorded: key for recorded, key in known.items() if key}
        named = Counter[str]()
        for recorded, count in counts.items():
            named[keys[recorded].whole] += count
        return cls(named, keys, first / NANOSECONDS, last / NANOSECONDS, zero, name, source)

    def played(self, at: float) -> Iterator[Played]:
        """All values from a time on [s; Unix time], in order."""
        for entry in self._source.entries(_floor(at)):
            if entry.key in self.keys:
                yield self._played(entry)

    def before(self, at: float) -> list[Played]:
        """The last value of each key before a time [s; Unix time], also from before the part that is played."""
        found = ((entry, play_key(entry.key, self.name)) for entry in self._source.latest(_floor(at)))
        return [Played(_time(entry), key, entry) for entry, key in found if key is not None]

    def between(self, begin: float, end: float, choice: Choice) -> list[Played]:
        """The values of some keys, as played, from one time to another [s; Unix time]; the newest `MOST_BETWEEN`."""
        wanted = {recorded for recorded, key in self.keys.items() if choice(key.whole)}
        first, last = (_floor(min(max(one, self.first), self.last)) for one in (begin, end))
        found = deque(self._source.entries(first, last + 1, wanted.__contains__), maxlen=MOST_BETWEEN)
        return [self._played(entry) for entry in found]

    def _played(self, entry: Entry) -> Played:
        return Played(_time(entry), self.keys[entry.key], entry)

    @property
    def vehicles(self) -> set[str]:
        """Names under `mk/` that values are put under."""
        parts = (key.split("/") for key in self.counts)
        return {vehicle for root, vehicle, *_ in parts if root == ROOT}

    @property
    def names(self) -> set[str]:
        """Names of all vehicles that are played."""
        return {key.split("/")[1] for key in self.counts}

    @property
    def total(self) -> int:
        """How many values."""
        return self.counts.total()


def read_ahead(entries: Iterator[Played]) -> Generator[Played]:
    """Yield values that another thread reads from the file before they are due; raises what reading raises."""
    with ThreadPoolExecutor(1, "play reader") as reader:
        reading = reader.submit(list, islice(entries, AHEAD))
        while part := reading.result():
            reading = reader.submit(list, islice(entries, AHEAD))
            yield from part
