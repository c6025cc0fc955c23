"""Reads recordings: everything that is whole in a file, and a report of what is not.

Guaranteed: whatever was done to a file, cut off or changed anywhere, reading raises nothing but an `MkError` when it
cannot be opened, and `OSError` when the disk fails; every entry whose chunk is whole is returned, in the order in which
it was recorded; what is missing is named in the report. A file that is being written is read up to its last flush.
"""

from __future__ import annotations

import os
import re
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode

from mkdaemon.errors import MkError
from mkdaemon.foreignfiles import open_regular
from mkdaemon.record.entry import SEQUENCES, Entry, EntryKind, TimeBase
from mkdaemon.record.layout import SESSION, VIEW, ChannelFacts, Session
from mkdaemon.record.scan import Damage, Record, ScannedChunk, Scanner, places_in, read_channel, read_metadata

_MESSAGE: Final = struct.Struct("<HIQQ")
FREE_RECORDS: Final = 100_000
"""The chunks of a file may have one record for each of its bytes, and these beside; the index of ours takes 16 each."""
Wanted = Callable[[ChannelFacts], bool]
"""Chooses channels."""
_END: Final = 1 << 64
"""Behind every time of a file [ns]."""


@dataclass(frozen=True, slots=True)
class _Place:
    """A chunk that was read.

    Attributes:
        offset: where its record begins [bytes].
        end: where it ends [bytes].
        first: earliest time in it [ns].
        last: latest time in it [ns].
        channels: numbers of those with messages in it.
    """

    offset: int
    end: int
    first: int
    last: int
    channels: frozenset[int]


@dataclass
class ReadReport:
    """What was found in a file; complete when its entries have all been read.

    Attributes:
        size: of the file [bytes].
        is_complete: whether it was finished: MCAP's own readers find its index.
        damages: parts that cannot be read.
        entries: how many were returned.
        gaps: how many entries of each kind and key are missing by their sequence numbers.
        records: how many were in its chunks.
        orphans: messages whose channel is nowhere in the file.
        unreadable: messages that their channel does not explain.
        foreign: messages of channels that another program wrote.
        views: messages that only show others as JSON.
    """

    size: int = 0
    is_complete: bool = False
    damages: list[Damage] = field(default_factory=list)
    entries: int = 0
    gaps: dict[tuple[EntryKind, str], int] = field(default_factory=dict)
    records: int = 0
    orphans: int = 0
    unreadable: int = 0
    foreign: int = 0
    views: int = 0

    @property
    def lost(self) -> int:
        """Entries missing by their sequence numbers."""
        return sum(self.gaps.values())

    @property
    def is_whole(self) -> bool:
        """Whether nothing at all is missing or damaged."""
        return self.is_complete and not (self.damages or self.gaps or self.orphans or self.unreadable)


class Recording:
    """One file.

    Attributes:
        path: the file.
        session: what it says about itself; None until it was read, and where it says nothing.
        report: what the last reading found.
        position: how much of the file the last reading has read [bytes].
    """

    def __init__(self, path: Path) -> None:
        """Name a file; it is opened when something is read."""
        self.path = path
        self.session: Session | None = None
        self.report = ReadReport()
        self.position = 0
        self._places: list[_Place] = []
        self._definitions: dict[int, Record] = {}

    def read_session(self) -> Session | None:
        """What the file says about itself; None where it says nothing.

        Raises:
            MkError: the file cannot be opened.
        """
        for record in self._records(ReadReport()):
            if self.session is not None:
                break
            self._take_metadata(record)
        return self.session

    def entries(
        self, wanted: Wanted = lambda facts: True, *, first: int | None = None, last: int | None = None
    ) -> Iterator[Entry]:
        """All entries, in the order in which they were recorded.

        Args:
            wanted: chooses by what is the same for all entries of a channel: kind, key, encoding.
            first: no entry before this [ns; times of the file].
            last: no entry after this [ns; times of the file].

        Raises:
            MkError: the file cannot be opened.
        """
        low, high = 0 if first is None else first, _END if last is None else last
        reading = _Reading(self, wanted)
        for chunk in self._chunks(reading, low, high):
            yield from reading.entries_of(chunk, low, high)

    def times(self, wanted: Wanted = lambda facts: True) -> Iterator[tuple[ChannelFacts, int]]:
        """Channel and time [ns; times of the file] of every entry, in order: what is known without unpacking it.

        Args:
            wanted: chooses channels.

        Raises:
            MkError: the file cannot be opened.
        """
        reading = _Reading(self, wanted)
        for chunk in self._chunks(reading, 0, _END):
            for channel, _, log_time, *_ in reading.messages_of(chunk, 0, _END):
                yield channel.facts, log_time

    def latest(self, wanted: Wanted, before: int) -> list[Entry]:
        """The last entry of each key before a time, in order of their times; quick once the whole file was read.

        Args:
            wanted: chooses channels.
            before: [ns; times of the file].

        Raises:
            MkError: the file cannot be opened.
        """
        if not self._places:
            deque(self.times(), maxlen=0)
        reading = _Reading(self, wanted)
        missing, found = reading.wanted, list[Entry]()
        with self._opened() as file:
            for place in reversed(self._places):
                if place.first < before and not missing.keys().isdisjoint(place.channels):
                    newest = {entry.key: entry for entry in reading.entries_of(self._at(file, place), 0, before - 1)}
                    found += (entry for key, entry in newest.items() if key in missing.values())
                    missing = {number: key for number, key in missing.items() if key not in newest}
        return sorted(found, key=lambda entry: entry.received)

    def again(self) -> Recording:
        """The same file for another thread; it knows what this one knows."""
        other = Recording(self.path)
        other.session, other._places, other._definitions = self.session, self._places, self._definitions
        return other

    def _chunks(self, reading: _Reading, low: int, high: int) -> Iterator[ScannedChunk]:
        """The chunks with times of a range [ns]; those that cannot be wanted are left out where the file is known."""
        if self._places and (low, high) != (0, _END):
            wanted = reading.wanted.keys()
            with self._opened() as file:
                for place in self._places:
                    if place.last >= low and place.first <= high and not wanted.isdisjoint(place.channels):
                        yield self._at(file, place)
            return
        places = list[_Place]()
        for record in self._records(reading.report):
            if isinstance(record, Record):
                reading.define(record)
                self._take_metadata(record)
            elif record.last >= low and record.first <= high:
                yield record
                places.append(_Place(record.offset, self.position, record.first, record.last, frozenset(reading.seen)))
                reading.seen.clear()
        if (low, high) == (0, _END):
            self._places, self._definitions = places, reading.definitions

    def _at(self, file: BinaryIO, place: _Place) -> ScannedChunk:
        """A chunk that was found before."""
        found = next(Scanner(file, place.end).records(place.offset), None)
        self.position = file.tell()
        if not isinstance(found, ScannedChunk):
            raise MkError(f"{self.path}: was changed while it was read")
        return found

    def span(self) -> tuple[int, int]:
        """Times of the earliest and of the latest entry [ns; times of the file]; zeros where there is none.

        Raises:
            MkError: the file cannot be opened.
        """
        times = [(one.first, one.last) for one in self._records(ReadReport()) if isinstance(one, ScannedChunk)]
        return min((first for first, _ in times), default=0), max((last for _, last in times), default=0)

    def definitions(self) -> Iterator[Record]:
        """All channels in the file, wherever they are."""
        report = ReadReport()
        for record in self._records(report):
            if isinstance(record, ScannedChunk):
                content = record.content()
                for opcode, begin, end in self.inside(record, report):
                    if opcode == Opcode.CHANNEL:
                        yield Record(opcode, content[begin:end])
            elif record.opcode == Opcode.CHANNEL:
                yield record

    def known_channels(self) -> Iterable[Record]:
        """Definitions of all channels, once the whole file was read."""
        return self._definitions.values()

    def inside(self, chunk: ScannedChunk, report: ReadReport) -> Iterator[tuple[int, int, int]]:
        """The records of a chunk, as far as they are whole, and no more than a file of this length can hold.

        Args:
            chunk: of this file, just read.
            report: counts them.

        Yields:
            Opcode, and where the record's content begins and ends in that of the chunk.
        """
        most = FREE_RECORDS + self.position
        with suppress(ValueError):
            for place in places_in(chunk.content()):
                report.records += 1
                if report.records > most:
                    if report.records == most + 1:
                        reason = "more records than a file of this size can hold"
                        report.damages.append(Damage(self.position, 0, reason))
                    return
                yield place

    def _opened(self) -> BinaryIO:
        try:
            return open_regular(self.path)
        except OSError as error:
            msg = f"{self.path}: cannot be opened ({error.strerror}); `mkctl log list` shows recordings"
            raise MkError(msg) from error

    def _records(self, report: ReadReport) -> Iterator[Record | ScannedChunk]:
        with self._opened() as file:
            report.size = os.fstat(file.fileno()).st_size
            scanner = Scanner(file, report.size)
            report.damages = scanner.damages
            for record in scanner.records():
                self.position = file.tell()
                yield record
            report.is_complete = scanner.is_complete

    def _take_metadata(self, record: Record | ScannedChunk) -> None:
        if isinstance(record, Record) and record.opcode == Opcode.METADATA:
            found = read_metadata(record.content)
            if found is not None and found[0] == SESSION:
                self.session = Session.from_metadata(found[1]) or self.session


@dataclass(slots=True)
class _Count:
    """Sequence numbers of one kind, key and clock.

    Attributes:
        due: the next one; None before the first.
    """

    due: int | None = None


@dataclass(frozen=True, slots=True)
class _Ours:
    """A channel with entries of ours.

    Attributes:
        facts: what is the same for all of them.
        is_wanted: whether they are.
        count: of their sequence numbers.
    """

    facts: ChannelFacts
    is_wanted: bool
    count: _Count


@dataclass(frozen=True, slots=True)
class _Other:
    """A channel without entries of ours."""

    is_view: bool


class _Reading:
    """One pass through a file.

    Attributes:
        report: what it finds.
        definitions: of the channels it met, by their numbers.
        seen: numbers of the channels that had messages since this was last cleared.
    """

    def __init__(self, recording: Recording, wanted: Wanted) -> None:
        self.report = recording.report = ReadReport()
        self.definitions: dict[int, Record] = {}
        self.seen: set[int] = set()
        self._recording = recording
        self._wanted = wanted
        self._channels: dict[int, _Ours | _Other] = {}
        self._is_complete = False
        self._counts: dict[tuple[EntryKind, str, TimeBase], _Count] = {}
        for record in recording.known_channels():
            self.define(record)

    @property
    def wanted(self) -> dict[int, str]:
        """Keys of the known channels that are wanted, by their numbers."""
        ours = ((number, one) for number, one in self._channels.items() if isinstance(one, _Ours))
        return {number: one.facts.key for number, one in ours if one.is_wanted}

    def define(self, record: Record) -> None:
        # Every chunk repeats its channels: of a file of many small ones reading them again was nearly all the work.
        if self.definitions.get(int.from_bytes(record.content[:2], "little")) == record:
            return
        if record.opcode == Opcode.CHANNEL and (channel := read_channel(record.content)) is not None:
            self.definitions[channel.number] = record
            facts = ChannelFacts.from_metadata(channel.metadata)
            if facts is None:
                self._channels[channel.number] = _Other(is_view=VIEW in channel.metadata)
                return
            count = self._counts.setdefault((facts.kind, facts.key, facts.base), _Count())
            self._channels[channel.number] = _Ours(facts, self._wanted(facts), count)

    def messages_of(self, chunk: ScannedChunk, low: int, high: int) -> Iterator[tuple[_Ours, int, int, int, int, int]]:
        """The messages that are wanted: channel, sequence, both times [ns], begin and end of the data in the chunk."""
        content, report, channels, seen = chunk.content(), self.report, self._channels, self.seen
        for opcode, begin, end in self._recording.inside(chunk, report):
            if opcode != Opcode.MESSAGE:
                if opcode == Opcode.CHANNEL:
                    self.define(Record(opcode, content[begin:end]))
                continue
            if end - begin < _MESSAGE.size:
                continue
            number, sequence, log_time, publish_time = _MESSAGE.unpack_from(content, begin)
            channel = channels.get(number) or self._found_later(number)
            seen.add(number)
            if isinstance(channel, _Ours):
                if channel.is_wanted and low <= log_time <= high:
                    self._count(channel, sequence)
                    yield channel, sequence, log_time, publish_time, begin + _MESSAGE.size, end
            elif channel is None:
                report.orphans += 1
            else:
                report.views += channel.is_view
                report.foreign += not channel.is_view

    def entries_of(self, chunk: ScannedChunk, low: int, high: int) -> Iterator[Entry]:
        content, report = chunk.content(), self.report
        for channel, sequence, log_time, publish_time, begin, end in self.messages_of(chunk, low, high):
            try:
                entry = channel.facts.unpack(content[begin:end], sequence, log_time, publish_time)
            except ValueError:
                report.unreadable += 1
                continue
            report.entries += 1
            yield entry

    def _found_later(self, number: int) -> _Ours | _Other | None:
        """A channel that should have come before; the whole file is searched once."""
        if not self._is_complete:
            self._is_complete = True
            known, definitions = dict(self._channels), dict(self.definitions)
            for record in self._recording.definitions():
                self.define(record)
            self._channels.update(known)
            self.definitions.update(definitions)
        return self._channels.get(number)

    def _count(self, channel: _Ours, sequence: int) -> None:
        count = channel.count
        if sequence == count.due or count.due is None:
            count.due = (sequence + 1) % SEQUENCES
            return
        missing = (sequence - count.due) % SEQUENCES
        if missing < SEQUENCES // 2:  # else it comes late: two files that overlap were joined
            count.due = (sequence + 1) % SEQUENCES
            gaps, place = self.report.gaps, (channel.facts.kind, channel.facts.key)
            gaps[place] = gaps.get(place, 0) + missing


def matches_any(key: str, patterns: Sequence[str]) -> bool:
    """Whether a key, with or without `mk/<vehicle>/`, matches one of the patterns; with no patterns every key does.

    Args:
        key: the whole key.
        patterns: with or without `mk/<vehicle>/`.
    """
    suffix = key.partition("/")[2].partition("/")[2]
    return not patterns or any(_compiled(one).fullmatch(name + "/") for one in patterns for name in (key, suffix))


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    """The pattern of a key with a slash behind it."""
    chunks = [_chunk(one) for one in pattern.split("/")]
    return re.compile("".join(chunks))


def _chunk(chunk: str) -> str:
    return "(?:[^/]+/)*" if chunk == "**" else re.escape(chunk).replace(r"\*", "[^/]*") + "/"
