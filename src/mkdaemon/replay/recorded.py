"""What a recording of one flight of the daemon says, sorted by kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from operator import getitem
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError

from mkdaemon.config.root import Config
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.foreignfiles import parse_json
from mkdaemon.record.entry import Entry, EntryKind, Notice, unpacked
from mkdaemon.record.layout import Session
from mkdaemon.record.reader import Recording

BLACK_BOX: Final = "blackbox"
_Model = TypeVar("_Model", bound=BaseModel)
_Part = TypeVar("_Part")


@dataclass
class Recorded:
    """One flight of one daemon.

    Attributes:
        session: what the recording says about itself.
        entries: in the order in which they were taken.
        lost: entries missing by their sequence numbers.
        damaged: parts of the files that could not be read.
    """

    session: Session
    entries: Sequence[Entry]
    lost: int = 0
    damaged: int = 0
    _by_kind: dict[EntryKind, list[Entry]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for entry in self.entries:
            self._by_kind.setdefault(entry.kind, []).append(entry)

    def of(self, kind: EntryKind) -> Sequence[Entry]:
        """The entries of a kind, in order."""
        return self._by_kind.get(kind, ())

    @property
    def start(self) -> float:
        """When the recording begins [s]."""
        return self.entries[0].received

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.entries[-1].received

    @property
    def stopped_at(self) -> float | None:
        """When the daemon was asked to end [s]; None if it did not end in order."""
        return next((entry.received for entry in self.notices(Notice.STOP)), None)

    @property
    def config(self) -> Config:
        """The configuration it flew with, without keys that are none today.

        Raises:
            ConfigError: the recording has none, or one that is not understood.
        """
        return self._flown_with[0]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Keys of its configuration that are none today; raises as `config`."""
        return self._flown_with[1]

    @cached_property
    def _flown_with(self) -> tuple[Config, tuple[str, ...]]:
        if not self.session.config:
            msg = f"{self.session.name}: the recording has no configuration; give the one it flew with as --config FILE"
            raise ConfigError(msg)
        gone: list[str] = []
        try:
            values = parse_json(self.session.config)
            while True:
                try:
                    return Config.model_validate(values), tuple(gone)
                except ValidationError as error:
                    unknown = [item["loc"] for item in error.errors() if item["type"] == "extra_forbidden"]
                    if not unknown:
                        raise
                    gone += [".".join(map(str, place)) for place in unknown]
                    for *path, key in unknown:
                        del reduce(getitem, path, values)[key]
        except (ValueError, ValidationError, LookupError, TypeError) as error:  # places in a stranger's file
            msg = (
                f"{self.session.name}: its configuration is not understood here ({str(error).splitlines()[0]}); "
                "give a corrected one as --config FILE"
            )
            raise ConfigError(msg) from error

    def notices(self, notice: Notice) -> Iterator[Entry]:
        """The notices of one sort."""
        return (entry for entry in self.of(EntryKind.NOTICE) if Notice.of(entry) is notice)

    def first_epoch(self) -> int:
        """Epoch of the first lease; 0 without one."""
        for entry in self.of(EntryKind.EVENT):
            epoch = part_of(entry, _epoch_of)
            if epoch is not None:
                return epoch
        return 0

    def wall_offsets(self) -> list[tuple[float, float]]:
        """Unix time less monotonic time [s] as the recorded daemon knew it, each with the time from which on [s]."""
        found: list[tuple[float, float]] = []
        for entry in self.of(EntryKind.SAMPLE):
            stamp = entry.carried_stamp
            if stamp is not None and stamp.boot == entry.base.boot:
                offset = stamp.wall - stamp.monotonic
                if not found or abs(offset - found[-1][1]) > 1e-6:
                    found.append((entry.received, offset))
        return found


def _epoch_of(fields: dict[str, Any]) -> int | None:
    """The lease that an event granted."""
    lease = (fields.get("reply") or {}).get("lease")
    return None if lease is None else int(lease["epoch"])


def read_recorded(paths: Sequence[Path]) -> Recorded:
    """Read the recording of one flight.

    Args:
        paths: its files, in any order.

    Raises:
        MkError: a file cannot be opened.
        ConfigError: these are not the files of one black box from its beginning on, or it did not keep the flight
            core's events.
    """
    files = [Recording(path) for path in paths]
    sessions: list[tuple[Session, Recording]] = []
    for file in files:
        session = file.read_session()
        if session is None:
            msg = f"{file.path}: no recording of mkdaemon, or cut off before its head; `mkctl log verify` says more"
            raise ConfigError(msg)
        sessions.append((session, file))
    sessions.sort(key=lambda pair: pair[0].part)
    _check_parts(sessions)
    entries = [entry for _, file in sessions for entry in file.entries()]
    if not entries:
        msg = f"{paths[0]}: nothing was recorded; a daemon that flies writes one (docs/recording.md)"
        raise ConfigError(msg)
    if not any(entry.kind is EntryKind.EVENT for entry in entries):
        msg = (
            f"{paths[0]}: recorded by {sessions[0][0].program}, which did not keep the flight core's events: it "
            "cannot be verified. `mkctl log play`, `mkctl log export`, `mkctl log` and the viewer show it as they did"
        )
        raise ConfigError(msg)
    reports = [file.report for file in files]
    return Recorded(
        sessions[0][0],
        entries,
        lost=sum(report.lost for report in reports),
        damaged=sum(len(report.damages) + report.orphans + report.unreadable for report in reports),
    )


def _check_parts(sessions: Sequence[tuple[Session, Recording]]) -> None:
    """Make sure that these are the parts of one black box, from the first one on."""
    first, file = sessions[0]
    for session, other in sessions:
        if session.recorder != BLACK_BOX:
            msg = (
                f"{other.path}: made by `{session.recorder}`; only the daemon's own black box has what went into it: "
                "bytes of the line, requests, times"
            )
            raise ConfigError(msg)
        if session.name != first.name:
            msg = f"{other.path} is of another recording than {file.path}; give the parts of one"
            raise ConfigError(msg)
    parts = [session.part for session, _ in sessions]
    if parts != list(range(len(parts))):
        known = ", ".join(map(str, parts))
        msg = (
            f"{file.path}: part {known} of recording {first.name}; what a daemon decides follows from all before: "
            "give every part from 0 on"
        )
        raise ConfigError(msg)


def fields_of(entry: Entry) -> dict[str, Any]:
    """What a payload says; nothing where it is not a map."""
    return unpacked(entry.payload)


def part_of(entry: Entry, read: Callable[[dict[str, Any]], _Part]) -> _Part:
    """What is read of the fields of an entry.

    Args:
        entry: the entry.
        read: makes the part of the fields.

    Raises:
        MkError: no daemon records it so.
    """
    try:
        return read(fields_of(entry))
    except (LookupError, ValueError, TypeError, AttributeError, OverflowError) as error:
        msg = (
            f"{entry.key}, entry {entry.sequence}: no daemon records it so ({error!r}); "
            "damaged or changed: replay the original"
        )
        raise MkError(msg) from error


def value_of(entry: Entry, model: type[_Model]) -> _Model:
    """What a payload says, as a value of today.

    Raises:
        MkError: it was written by a version that says it in another way.
    """
    try:
        return model.model_validate(fields_of(entry))
    except ValidationError as error:
        msg = (
            f"{entry.key}, value {entry.sequence}: not as {model.__name__} is today "
            f"({', '.join(str(error).splitlines()[1:3])}); replay it with the version that recorded it"
        )
        raise MkError(msg) from error
