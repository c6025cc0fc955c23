"""What a recording of one flight of the daemon says, sorted into what went in and what came out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

import msgpack
from pydantic import BaseModel, ValidationError

from mkdaemon.config.root import Config
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.reading import parse_json
from mkdaemon.record.entry import Entry, Kind, Notice
from mkdaemon.record.layout import Session
from mkdaemon.record.looks import Look, unpack_looks
from mkdaemon.record.reader import Recording
from mkdaemon.replay.port import Refusal
from mkdaemon.replay.script import Moment
from mkdaemon.telemetry.link import LinkCondition

BLACK_BOX: Final = "blackbox"
_Model = TypeVar("_Model", bound=BaseModel)


@dataclass
class Recorded:
    """One flight of one daemon.

    Attributes:
        session: what the recording says about itself.
        moments: every entry, in the order in which it was taken.
        looks: what the daemon saw on its clock, in order.
        backlogs: before which look, and how many bytes waited in the port from then on.
        lost: entries missing by their sequence numbers.
        damaged: parts of the files that could not be read.
    """

    session: Session
    moments: list[Moment]
    looks: list[Look]
    backlogs: list[tuple[int, int]]
    lost: int = 0
    damaged: int = 0
    _by_kind: dict[Kind, list[Moment]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for moment in self.moments:
            self._by_kind.setdefault(moment.entry.kind, []).append(moment)

    def of(self, *kinds: Kind) -> list[Moment]:
        """The moments of some kinds, in order."""
        if len(kinds) == 1:
            return self._by_kind.get(kinds[0], [])
        return [moment for moment in self.moments if moment.entry.kind in kinds]

    @property
    def start(self) -> float:
        """When the recording begins [s]."""
        return min(self.moments[0].at, self.looks[0].at)

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return max(self.moments[-1].at, self.looks[-1].at)

    @property
    def stopped_at(self) -> float | None:
        """When the daemon was told to stop [s]; None where it did not end in order."""
        return next((moment.at for moment in self.notices(Notice.STOP)), None)

    @property
    def config(self) -> Config:
        """The configuration it flew with.

        Raises:
            ConfigError: the recording has none, or one of another time.
        """
        if not self.session.config:
            msg = f"{self.session.name}: the recording has no configuration; give the one it flew with as --config FILE"
            raise ConfigError(msg)
        try:
            return Config.model_validate(parse_json(self.session.config))
        except (ValueError, ValidationError) as error:
            msg = (
                f"{self.session.name}: its configuration is not understood here ({str(error).splitlines()[0]}); "
                "give a corrected one as --config FILE"
            )
            raise ConfigError(msg) from error

    def notices(self, notice: Notice) -> Iterator[Moment]:
        """What the daemon was told of one kind."""
        for moment in self.of(Kind.NOTICE):
            if Notice.of(moment.entry) is notice:
                yield moment

    def samples(self, *suffixes: str) -> Iterator[Moment]:
        """Published values of some keys."""
        for moment in self.of(Kind.SAMPLE):
            if moment.entry.suffix in suffixes:
                yield moment

    def replies(self) -> dict[int, Entry]:
        """Every reply, by the number of its exchange."""
        return {moment.entry.exchange: moment.entry for moment in self.of(Kind.REPLY)}

    def refusals(self) -> list[Refusal]:
        """When the line was found absent or unusable."""
        states = [(moment.at, fields_of(moment.entry)) for moment in self.samples("link/state")]
        return [
            Refusal(at, str(fields.get("reason", "")), fields["condition"] == LinkCondition.ABSENT)
            for at, fields in states
            if fields.get("condition") in {LinkCondition.ABSENT, LinkCondition.DOWN}
        ]

    def first_epoch(self) -> int | None:
        """Epoch of the first lease; None where nobody took one."""
        for moment in self.of(Kind.REPLY):
            reply = fields_of(moment.entry).get("reply") if moment.entry.suffix == "do/lease" else None
            if isinstance(reply, dict) and "secret" in reply:
                return int(reply["epoch"])
        return None

    def wall_offsets(self) -> list[tuple[float, float]]:
        """Unix time less monotonic time [s] as the recorded daemon knew it, each with the time from which on [s]."""
        found: list[tuple[float, float]] = []
        for moment in self.of(Kind.SAMPLE):
            stamp = fields_of(moment.entry).get("stamp")
            if isinstance(stamp, dict) and stamp.get("boot") == moment.entry.base.boot:
                offset = stamp["wall"] - stamp["monotonic"]
                if not found or abs(offset - found[-1][1]) > 1e-6:
                    found.append((moment.at, offset))
        return found


def read_recorded(paths: Sequence[Path]) -> Recorded:
    """Read the recording of one flight.

    Args:
        paths: its files, in any order.

    Raises:
        MkError: a file cannot be opened.
        ConfigError: these are not the files of one black box from its beginning on.
    """
    files = [Recording(path) for path in paths]
    sessions: list[tuple[Session, Recording]] = []
    for file in files:
        session = file.read_session()
        if session is None:
            msg = f"{file.path}: no recording of mkdaemon, or cut off before its head; `mkctl log check` says more"
            raise ConfigError(msg)
        sessions.append((session, file))
    sessions.sort(key=lambda pair: pair[0].part)
    _check_parts(sessions)
    entries = [entry for _, file in sessions for entry in file.entries()]
    if not entries:
        msg = f"{paths[0]}: nothing was recorded; a daemon that flies writes one (docs/recording.md)"
        raise ConfigError(msg)
    reports = [file.report for file in files]
    return arrange(
        entries,
        sessions[0][0],
        lost=sum(report.lost for report in reports),
        damaged=sum(len(report.damages) + report.orphans + report.unreadable for report in reports),
    )


def arrange(entries: Sequence[Entry], session: Session, *, lost: int = 0, damaged: int = 0) -> Recorded:
    """Tell what was seen on the clock from what came in and out, and keep their order.

    Raises:
        ConfigError: nothing is known of what the daemon saw on its clock.
    """
    moments: list[Moment] = []
    looks: list[Look] = []
    backlogs: list[tuple[int, int]] = []
    for entry in entries:
        if Notice.of(entry) is Notice.LOOKS:
            found = unpack_looks(entry.payload)
            backlogs += [(len(looks) + before, size) for before, size in found.backlogs]
            looks += found.looks
        else:
            moments.append(Moment(entry.received, entry, len(looks)))
    if not looks:
        msg = f"{session.name}: recorded by {session.program}, which did not keep what it saw on its clock"
        raise ConfigError(msg)
    return Recorded(session, moments, looks, backlogs, lost, damaged)


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
    """What a payload says; nothing where it is no map."""
    try:
        fields = msgpack.unpackb(entry.payload, strict_map_key=False)
    except (ValueError, msgpack.exceptions.UnpackException):
        return {}
    return fields if isinstance(fields, dict) else {}


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
