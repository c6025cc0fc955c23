"""Waypoint lists that an upload may have left half written: noted before, announced at the next start."""

from __future__ import annotations

import asyncio
from typing import Final

from pydantic import BaseModel, ConfigDict, ValidationError

from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.procedures.journal import Journal
from mkdaemon.files import flush_folder, write_whole
from mkdaemon.reading import LONGEST_TEXT, read_bytes

_FILE: Final = "waypoint-list.json"


class ListNote(BaseModel):
    """An upload or clearing that has begun."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    verb: str
    """What it is."""
    holder: str
    """Who asked for it."""
    source: str
    """Where the points came from."""
    t_wall: float
    """When it began, Unix time [s]."""


class UnfinishedList:
    """The note of the list that is being written; it goes when a list was stored or cleared and read back."""

    def __init__(self, journal: Journal, audit: Audit) -> None:
        """Tell what an earlier daemon left beside the journal."""
        self._path = journal.folder / _FILE
        self._disk = journal.disk
        self._audit = audit
        if self._path.exists():
            audit.log("warning", f"{self._words()}: do not fly the list before it was uploaded again or cleared")

    async def begin(self, note: ListNote) -> None:
        """Keep a note; a folder that cannot be written is announced, and no reason to refuse an upload."""
        try:
            await asyncio.get_running_loop().run_in_executor(self._disk, self._write, note)
        except OSError as error:
            self._audit.log("warning", f"{self._path}: cannot be written ({error.strerror or error})")

    async def end(self) -> None:
        """A list was read back: the note goes."""
        try:
            await asyncio.get_running_loop().run_in_executor(self._disk, self._remove)
        except OSError as error:
            self._audit.log("warning", f"{self._path}: cannot be removed ({error.strerror or error})")

    def _write(self, note: ListNote) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._path, note.model_dump_json() + "\n", overwrite=True)

    def _remove(self) -> None:
        self._path.unlink(missing_ok=True)
        flush_folder(self._path.parent)

    def _words(self) -> str:
        try:
            note = ListNote.model_validate_json(read_bytes(self._path, LONGEST_TEXT))
        except (OSError, ValidationError):
            return "an upload was cut off and the NaviCtrl's list may be incomplete"
        about = f" of {note.source}" if note.source else ""
        return f"{note.verb}{about} was cut off and the NaviCtrl's list may be incomplete"
