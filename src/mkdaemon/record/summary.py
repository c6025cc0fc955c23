"""Figures and senders of a recording; `glance` reads only its beginning and end."""

from __future__ import annotations

import math
import os
import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from mcap.opcode import Opcode

from mkdaemon.errors import MkError
from mkdaemon.foreignfiles import open_regular
from mkdaemon.record.countcheck import CountCheck
from mkdaemon.record.entry import HOLDER, ROOTS, Entry, EntryKind, Notice, unpacked
from mkdaemon.record.layout import MAGIC, Session
from mkdaemon.record.reader import ReadReport, Recording
from mkdaemon.record.scan import records_in
from mkdaemon.stamp import NANOSECONDS
from mkdaemon.telemetry.refusals import Token

LEASE: Final = "do/lease"
_ACCEPTED: Final = "accepted"
UNDER_WAY: Final = 0.5
"""Who held a lease that has ended, as after a landing, hears of it so late at most [s]: `lease.max_path_delay`."""


@dataclass
class Sender:
    """One session.

    Attributes:
        source: its Zenoh id, as it says itself; `local` for the Unix socket; empty for those that say none.
        names: under which it asked for the lease.
        setpoints: that arrived.
        signed: of these, signed with the secret of the lease.
        setpoints_refused: of these, by token.
        setpoints_late: of these, when its lease had just ended: they were under way.
        requests: that arrived.
        requests_refused: of these, not accepted.
    """

    source: str
    names: set[str] = field(default_factory=set)
    setpoints: int = 0
    signed: int = 0
    setpoints_refused: dict[str, int] = field(default_factory=dict)
    setpoints_late: int = 0
    requests: int = 0
    requests_refused: int = 0


SENT: Final = frozenset({EntryKind.SETPOINT, EntryKind.QUERY, EntryKind.REPLY, EntryKind.NOTICE})
"""Kinds of entries that tell of them."""


class Senders:
    """Counts them.

    Attributes:
        found: by source.
    """

    def __init__(self) -> None:
        self.found: dict[str, Sender] = {}
        self._setpoints: dict[str, tuple[int, Sender]] = {}
        self._asking: dict[int, Sender] = {}
        self._signed_at: dict[str, float] = {}

    def take(self, entry: Entry) -> None:
        """Count an entry."""
        if entry.kind is EntryKind.SETPOINT:
            sender = self._sender(entry)
            sender.setpoints += 1
            if entry.issuer == HOLDER:
                sender.signed += 1
                self._signed_at[entry.source] = entry.received
            self._setpoints[entry.suffix] = (entry.sequence, sender)
        elif entry.kind is EntryKind.QUERY:
            sender = self._asking[entry.exchange] = self._sender(entry)
            sender.requests += 1
            if entry.suffix == LEASE and (holder := unpacked(entry.payload).get("holder")):
                sender.names.add(str(holder))
        elif entry.kind is EntryKind.REPLY:
            asked = self._asking.pop(entry.exchange, None)
            if asked is not None:
                asked.requests_refused += unpacked(entry.payload).get("status") != _ACCEPTED
        elif Notice.of(entry) is Notice.SETPOINT_REFUSED:
            self._count_refused(unpacked(entry.payload), entry.received)

    def _sender(self, entry: Entry) -> Sender:
        return self.found.setdefault(entry.source, Sender(entry.source))

    def _count_refused(self, fields: dict[str, Any], at: float) -> None:
        sequence, sender = self._setpoints.get(str(fields.get("key")), (0, None))
        if sender is not None and sequence == fields.get("sequence"):
            token = str(fields.get("token"))
            if token == Token.NOT_LEASED and at - self._signed_at.get(sender.source, -math.inf) < UNDER_WAY:
                sender.setpoints_late += 1
                return
            sender.setpoints_refused[token] = sender.setpoints_refused.get(token, 0) + 1


MARK: Final = "event/mark"
Progress = Callable[[int], None]
"""Takes how many bytes of a file have been read."""


STRETCHES: Final = 64
"""Of an `Activity`."""
SHORTEST: Final = NANOSECONDS // 20
"""First length of a stretch [ns]."""


class Activity:
    """How many entries came when; takes no more memory for longer recordings: stretches of time grow."""

    def __init__(self, origin: int) -> None:
        """Count from a time on [ns; times of the file]."""
        self._origin, self._length = origin, SHORTEST
        self._counts = [0] * STRETCHES

    def take(self, at: int) -> None:
        """Count an entry of a time [ns]."""
        place = max(at - self._origin, 0) // self._length
        while place >= STRETCHES:
            pairs = zip(self._counts[::2], self._counts[1::2], strict=True)
            self._counts = [one + other for one, other in pairs] + [0] * (STRETCHES // 2)
            self._length *= 2
            place //= 2
        self._counts[place] += 1

    def over(self, end: int, columns: int) -> list[int]:
        """Entries in equal parts of the time until an end [ns]."""
        span, found = max(end - self._origin, 1), [0] * columns
        for place, count in enumerate(self._counts):
            middle = (2 * place + 1) * self._length // 2
            found[min(middle * columns // span, columns - 1)] += count
        return found


@dataclass
class KeySummary:
    """All entries of one kind and key.

    Attributes:
        kind: of them.
        key: of them.
        encoding: of the last one.
        count: how many.
        size: of their payloads together [bytes].
        first: time of the earliest [ns; times of the file].
        last: time of the latest [ns].
        longest_gap_ns: longest time between two of them [ns].
        lost: missing by their sequence numbers.
        activity: how many came when.
    """

    kind: EntryKind
    key: str
    activity: Activity
    encoding: str = ""
    count: int = 0
    size: int = 0
    first: int = 0
    last: int = 0
    longest_gap_ns: int = 0
    lost: int = 0

    @property
    def longest_gap(self) -> float:
        """Longest time between two of them [s]."""
        return self.longest_gap_ns / NANOSECONDS

    @property
    def rate(self) -> float:
        """Mean rate [Hz]; 0 for a single one."""
        span = (self.last - self.first) / NANOSECONDS
        return (self.count - 1) / span if span > 0 else 0.0

    def take(self, entry: Entry, at: int) -> None:
        """Count an entry."""
        if self.count and at > self.last + self.longest_gap_ns:
            self.longest_gap_ns = at - self.last
        self.encoding = entry.encoding
        self.count += 1
        self.size += len(entry.payload)
        if at < self.first or not self.first:
            self.first = at
        if at > self.last:
            self.last = at
        self.activity.take(at)


@dataclass(frozen=True, slots=True)
class Mark:
    """A marked moment.

    Attributes:
        at: when [ns; times of the file].
        vehicle: whose.
        text: what happened.
    """

    at: int
    vehicle: str
    text: str


@dataclass
class Summary:
    """A whole file.

    Attributes:
        path: the file.
        session: what it says about itself.
        report: what was found in it.
        keys: by kind and key, in the order in which they first appear.
        marks: in the order in which they were set.
        missed: values that daemons counted and that are not in the file, by key; of keys that are in it.
        senders: who sent setpoints and requests.
    """

    path: Path
    session: Session | None
    report: ReadReport
    keys: dict[tuple[EntryKind, str], KeySummary] = field(default_factory=dict)
    marks: list[Mark] = field(default_factory=list)
    missed: Counter[str] = field(default_factory=Counter)
    senders: Senders = field(default_factory=Senders)

    @property
    def first(self) -> int:
        """Time of the earliest entry [ns]; 0 where there is none."""
        return min((one.first for one in self.keys.values()), default=0)

    @property
    def last(self) -> int:
        """Time of the latest entry [ns]; 0 where there is none."""
        return max((one.last for one in self.keys.values()), default=0)

    @property
    def duration(self) -> float:
        """From the earliest to the latest entry [s]."""
        return (self.last - self.first) / NANOSECONDS

    @property
    def vehicles(self) -> list[str]:
        """Whose entries these are."""
        parts = (key.split("/") for _, key in self.keys)
        return sorted({part[1] for part in parts if part[0] in ROOTS and len(part) > 2})


Taker = Callable[[Entry, int], None]
"""Takes an entry, and its time [ns; times of the file]."""


def summarise(
    path: Path,
    progress: Progress = lambda position: None,
    taker_of: Callable[[Entry], Taker | None] = lambda entry: None,
) -> Summary:
    """Read a whole file.

    Args:
        path: the file.
        progress: hears how far it is, now and then.
        taker_of: says by the first entry of each kind and key who is given all of them as well, in order.

    Raises:
        MkError: it cannot be opened.
    """
    recording = Recording(path)
    summary = Summary(path, None, recording.report)
    checks: dict[str, CountCheck] = {}
    routes: dict[tuple[EntryKind, str], _Route] = {}
    origin = 0
    for number, entry in enumerate(recording.entries()):
        at = entry.base.file_time(entry.received)
        origin = origin or at
        place = (entry.kind, entry.key)
        route = routes.get(place)
        if route is None:
            found = summary.keys[place] = KeySummary(*place, Activity(origin))
            check = checks.setdefault(entry.vehicle, CountCheck()) if entry.kind is EntryKind.SAMPLE else None
            route = routes[place] = _Route(found, check, entry.suffix, entry.kind in SENT, taker_of(entry))
        route.found.take(entry, at)
        if route.is_sent:
            summary.senders.take(entry)
        if route.taker is not None:
            route.taker(entry, at)
        if route.check is not None:
            route.check.take(route.suffix, entry.payload)
            if route.suffix == MARK:
                summary.marks.append(Mark(at, entry.vehicle, _text_of(entry)))
        if number % 1000 == 0:
            progress(recording.position)
    summary.session, summary.report = recording.session, recording.report
    for vehicle, check in checks.items():
        for suffix, lost in check.lost.items():
            key = f"mk/{vehicle}/{suffix}"
            if (EntryKind.SAMPLE, key) in summary.keys:
                summary.missed[key] = lost
    for place, lost in recording.report.gaps.items():
        summary.keys[place].lost = lost
    return summary


class _Route(NamedTuple):
    """What is counted of the entries of one kind and key.

    Attributes:
        found: their figures.
        check: of the daemon's counts; None for what is not a published value.
        suffix: of the key.
        is_sent: they tell of senders.
        taker: is given them as well.
    """

    found: KeySummary
    check: CountCheck | None
    suffix: str
    is_sent: bool
    taker: Taker | None


def _text_of(entry: Entry) -> str:
    return str(unpacked(entry.payload).get("text", "?"))


_FOOTER: Final = struct.Struct("<BQQQI")
_STATISTICS: Final = struct.Struct("<QHIIIIQQ")
_LONGEST_SUMMARY: Final = 1 << 26
"""A longer index is taken for damage [bytes]."""


@dataclass(frozen=True, slots=True)
class Glance:
    """What the beginning and the end of a file say.

    Attributes:
        path: the file.
        size: [bytes].
        session: None where it says nothing about itself.
        first: time of the earliest entry [ns]; None where the file was not finished.
        last: time of the latest entry [ns]; None where the file was not finished.
    """

    path: Path
    size: int
    session: Session | None
    first: int | None = None
    last: int | None = None

    @property
    def is_finished(self) -> bool:
        """Whether it has an index."""
        return self.first is not None

    @property
    def duration(self) -> float | None:
        """From the earliest to the latest entry [s]."""
        return None if self.first is None or self.last is None else (self.last - self.first) / NANOSECONDS


def glance(path: Path) -> Glance:
    """Look at a file.

    Raises:
        MkError: it cannot be opened.
    """
    session = Recording(path).read_session()
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            times = _times(file, size)
    except OSError as error:
        msg = f"{path}: cannot be read ({error.strerror})"
        raise MkError(msg) from error
    return Glance(path, size, session) if times is None else Glance(path, size, session, *times)


def _times(file: BinaryIO, size: int) -> tuple[int, int] | None:
    """First and last time from the index; None where there is none."""
    end = size - len(MAGIC) - _FOOTER.size
    if end < 0:
        return None
    file.seek(end)
    opcode, length, start, _, _ = _FOOTER.unpack(file.read(_FOOTER.size))
    if file.read() != MAGIC or opcode != Opcode.FOOTER or length != 20 or not end - _LONGEST_SUMMARY < start <= end:
        return None
    file.seek(start)
    try:
        for record in records_in(file.read(end - start)):
            if record.opcode == Opcode.STATISTICS and len(record.content) >= _STATISTICS.size:
                *_, first, last = _STATISTICS.unpack_from(record.content)
                return first, last
    except ValueError:
        pass
    return None
