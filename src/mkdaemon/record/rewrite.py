"""New recordings from old ones: recovered, cut, joined. The old ones are only read."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.files import saving
from mkdaemon.record.entry import Entry
from mkdaemon.record.layout import ChannelFacts, Session
from mkdaemon.record.reader import ReadReport, Recording
from mkdaemon.record.writer import RecordingWriter, View

Progress = Callable[[int], None]
"""Takes how many bytes of all files have been read."""
_STEP: Final = 1000
"""Entries between two reports of progress."""
_UNKNOWN: Final = Session("unknown", "unknown", 0, "unknown", "", "", 0)


@dataclass(frozen=True, slots=True)
class Selection:
    """What is taken.

    Attributes:
        wanted: chooses by kind, key and encoding.
        first: nothing before this [ns; times of the file]; None for the beginning.
        last: nothing after this [ns]; None for the end.
    """

    wanted: Callable[[ChannelFacts], bool] = lambda facts: True
    first: int | None = None
    last: int | None = None


@dataclass(frozen=True, slots=True)
class Rewritten:
    """What became of it.

    Attributes:
        entries: written.
        reports: what was found in each file that was read.
    """

    entries: int
    reports: tuple[ReadReport, ...]


def recover(
    source: Path,
    target: Path,
    *,
    overwrite: bool = False,
    view: View | None = None,
    progress: Progress = lambda at: None,
) -> Rewritten:
    """Write everything that is whole in a damaged file into a new one, which has an index.

    Args:
        source: the damaged file.
        target: the new one.
        overwrite: replace what is there.
        view: adds JSON for viewers.
        progress: hears how far it is.

    Raises:
        ConfigError: the new file is there already, or has no folder.
        MkError: nothing can be read of the old one, or the new one cannot be written.
    """
    file = Recording(source)
    session = file.read_session() or replace(_UNKNOWN, name=source.stem)
    return _write([file], file.entries(), session, target, overwrite=overwrite, view=view, progress=progress)


def cut(
    source: Path,
    target: Path,
    selection: Selection,
    *,
    overwrite: bool = False,
    view: View | None = None,
    progress: Progress = lambda at: None,
) -> Rewritten:
    """Write a part of a recording into a new one.

    Args:
        source: the whole.
        target: the part.
        selection: what is taken.
        overwrite: replace what is there.
        view: adds JSON for viewers.
        progress: hears how far it is.

    Raises:
        ConfigError: the new file is there already, or has no folder.
        MkError: nothing of it is selected, or a file cannot be read or written.
    """
    file = Recording(source)
    session = replace(file.read_session() or replace(_UNKNOWN, name=source.stem), recorder="cut")
    entries = file.entries(selection.wanted, first=selection.first, last=selection.last)
    return _write([file], entries, session, target, overwrite=overwrite, view=view, progress=progress)


def merge(
    sources: Sequence[Path],
    target: Path,
    *,
    overwrite: bool = False,
    view: View | None = None,
    progress: Progress = lambda at: None,
) -> Rewritten:
    """Join recordings by the time of their entries; what one file has keeps its order.

    Args:
        sources: parts of one recording, or recordings of several machines, whose clocks are to agree then.
        target: the new file.
        overwrite: replace what is there.
        view: adds JSON for viewers.
        progress: hears how far it is.

    Raises:
        ConfigError: the new file is there already or has no folder, or a part is given twice.
        MkError: a file cannot be read or written.
    """
    files = [Recording(path) for path in sources]
    sessions = [file.read_session() or replace(_UNKNOWN, name=file.path.stem) for file in files]
    places: dict[tuple[str, int], Path] = {}
    for file, session in zip(files, sessions, strict=True):
        other = places.setdefault((session.name, session.part), file.path)
        if other is not file.path:
            msg = f"{file.path} and {other} are the same part of recording {session.name}: give one of them"
            raise ConfigError(msg)
    vehicles = {session.vehicle for session in sessions}
    session = replace(sessions[0], recorder="merge", vehicle=vehicles.pop() if len(vehicles) == 1 else "")
    entries = heapq.merge(*(file.entries() for file in files), key=lambda entry: entry.base.file_time(entry.received))
    return _write(files, entries, session, target, overwrite=overwrite, view=view, progress=progress)


def _write(
    files: Sequence[Recording],
    entries: Iterable[Entry],
    session: Session,
    target: Path,
    *,
    overwrite: bool,
    view: View | None,
    progress: Progress,
) -> Rewritten:
    """Write entries into a new file.

    Raises:
        ConfigError: the new file is there already, or has no folder.
        MkError: there are no entries, or too many keys, or it cannot be written.
    """
    with saving(target, overwrite=overwrite) as output:
        writer = RecordingWriter(output, session, view)
        for entry in _reporting(entries, files, progress):
            if writer.is_full:
                msg = f"{target}: too many keys for one file; take some of them, with `mkctl log cut --key`"
                raise MkError(msg)
            writer.add(entry)
        if not writer.entries:
            names = ", ".join(str(file.path) for file in files)
            msg = f"{names}: no entry is whole, or none is selected; `mkctl log info` shows what there is"
            raise MkError(msg)
        writer.finish()
    return Rewritten(writer.entries, tuple(file.report for file in files))


def _reporting(entries: Iterable[Entry], files: Sequence[Recording], progress: Progress) -> Iterator[Entry]:
    for number, entry in enumerate(entries):
        if number % _STEP == 0:
            progress(sum(file.position for file in files))
        yield entry
