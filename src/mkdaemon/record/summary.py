"""What a recording holds, in figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgpack

from mkdaemon.record.countcheck import CountCheck
from mkdaemon.record.entry import NANOSECONDS, ROOTS, Entry, Kind
from mkdaemon.record.layout import Session
from mkdaemon.record.reader import ReadReport, Recording
from mkdaemon.record.senders import Senders

MARK: Final = "event/mark"
Progress = Callable[[int], None]
"""Takes how many bytes of a file have been read."""


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
        longest_gap: longest time between two of them [s].
        lost: missing by their sequence numbers.
    """

    kind: Kind
    key: str
    encoding: str = ""
    count: int = 0
    size: int = 0
    first: int = 0
    last: int = 0
    longest_gap: float = 0.0
    lost: int = 0

    @property
    def rate(self) -> float:
        """Mean rate [Hz]; 0 for a single one."""
        span = (self.last - self.first) / NANOSECONDS
        return (self.count - 1) / span if span > 0 else 0.0

    def take(self, entry: Entry, at: int) -> None:
        """Count an entry."""
        if self.count:
            self.longest_gap = max(self.longest_gap, (at - self.last) / NANOSECONDS)
        self.encoding, self.count, self.size = entry.encoding, self.count + 1, self.size + len(entry.payload)
        self.first = min(self.first, at) if self.first else at
        self.last = max(self.last, at)


@dataclass(frozen=True, slots=True)
class Mark:
    """A moment that somebody marked.

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
    keys: dict[tuple[Kind, str], KeySummary] = field(default_factory=dict)
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


def summarise(path: Path, progress: Progress = lambda position: None) -> Summary:
    """Read a whole file.

    Args:
        path: the file.
        progress: hears how far it is, now and then.

    Raises:
        MkError: it cannot be opened.
    """
    recording = Recording(path)
    summary = Summary(path, None, recording.report)
    checks: dict[str, CountCheck] = {}
    for number, entry in enumerate(recording.entries()):
        at = entry.base.file_time(entry.received)
        place = (entry.kind, entry.key)
        found = summary.keys.get(place)
        if found is None:
            found = summary.keys[place] = KeySummary(*place)
        found.take(entry, at)
        summary.senders.take(entry)
        if entry.kind is Kind.SAMPLE:
            checks.setdefault(entry.vehicle, CountCheck()).take(entry.suffix, entry.payload)
            if entry.suffix == MARK:
                summary.marks.append(Mark(at, entry.vehicle, _text_of(entry)))
        if number % 1000 == 0:
            progress(recording.position)
    summary.session, summary.report = recording.session, recording.report
    for vehicle, check in checks.items():
        for suffix, lost in check.lost.items():
            key = f"mk/{vehicle}/{suffix}"
            if (Kind.SAMPLE, key) in summary.keys:
                summary.missed[key] = lost
    for place, lost in recording.report.gaps.items():
        summary.keys[place].lost = lost
    return summary


def _text_of(entry: Entry) -> str:
    try:
        return str(msgpack.unpackb(entry.payload)["text"])
    except (ValueError, TypeError, KeyError, msgpack.exceptions.UnpackException):
        return "?"
