"""The journal on disk: the parameter set that must be live, noted before any request that may change it.

One small file a procedure, `<state folder>/live-set-<id>.json`, written whole and flushed before the first request that
loads another set, removed when the live set is proven.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Final, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from mkdaemon.config.vehicle import VehicleConfig
from mkdaemon.files import flush_folder, user_folder, write_whole
from mkdaemon.foreignfiles import LONGEST_TEXT, read_bytes
from mkdaemon.protocol.procedures.steps import LiveSet
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.refusals import Token, refuse

_PREFIX: Final = "live-set-"

_Argument = TypeVar("_Argument")


class Note(BaseModel):
    """A live set that is at risk."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_bytes="hex", val_json_bytes="hex")

    version: Literal[1] = 1
    """Of this form; a note of another one is not understood."""
    id: str
    """Of the procedure."""
    verb: str
    """What it is."""
    holder: str
    """The client that asked for it."""
    stamp: Stamp
    """When the note was taken."""
    board: str = "fc"
    """Whose sets."""
    firmware: str
    """Release of the FlightCtrl."""
    active: int
    """Number of the set that has to be live."""
    live: bytes
    """Its bytes."""
    writing: dict[int, bytes]
    """Bytes of the sets about to be written, by number; empty where sets are only read."""

    @property
    def wanted(self) -> LiveSet:
        """The set that must be live."""
        return LiveSet(self.firmware, self.active, self.live, self.writing)


class Journal:
    """The notes of one vehicle.

    Attributes:
        folder: where they are.
        disk: changes files of the folder, one change after the other.
    """

    def __init__(self, folder: Path, disk: Executor | None = None) -> None:
        """Use a folder; it is made when the first note is taken.

        Args:
            folder: of the vehicle.
            disk: a single thread by default; with two, the removal of a note could overtake its writing after the
                waiting task was cancelled.
        """
        self.folder = folder
        self.disk = disk or ThreadPoolExecutor(1, thread_name_prefix="journal")

    def read(self) -> tuple[list[Note], list[Path]]:
        """Return the notes, oldest first, and what cannot be read as one: files, or the whole folder."""
        notes: list[Note] = []
        strange: list[Path] = []
        try:
            paths = sorted(self.folder.iterdir())
        except (FileNotFoundError, NotADirectoryError):
            return [], []
        except OSError:
            return [], [self.folder]
        for path in [path for path in paths if path.match(f"{_PREFIX}*.json")]:
            try:
                notes.append(Note.model_validate_json(read_bytes(path, LONGEST_TEXT)))
            except (OSError, ValidationError):
                strange.append(path)
        return sorted(notes, key=lambda note: note.stamp.wall), strange

    async def keep(self, note: Note) -> None:
        """Keep a note; returns when it is on the disk, which may take longer than control can wait.

        Raises:
            CommandRejectedError: `journal_unwritable`.
        """
        await self._change(self.write, note)

    async def drop(self, note_id: str) -> None:
        """Forget a note; one that is gone already is no error.

        Raises:
            CommandRejectedError: `journal_unwritable`.
        """
        await self._change(self.discard, note_id)

    async def _change(self, change: Callable[[_Argument], None], argument: _Argument) -> None:
        try:
            await asyncio.get_running_loop().run_in_executor(self.disk, change, argument)
        except OSError as error:
            raise refuse(Token.JOURNAL_UNWRITABLE, detail=f"{self.folder}: {error.strerror or error}") from error

    def write(self, note: Note) -> None:
        """Keep a note, see `keep`.

        Raises:
            OSError: it cannot be kept.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self._path(note.id), note.model_dump_json(indent=1) + "\n", overwrite=True)

    def discard(self, note_id: str) -> None:
        """Forget a note, see `drop`.

        Raises:
            OSError: it cannot be removed.
        """
        path = self._path(note_id)
        if path.exists():
            path.unlink()
            flush_folder(self.folder)

    def _path(self, note_id: str) -> Path:
        return self.folder / f"{_PREFIX}{note_id}.json"


def state_folder(vehicle: VehicleConfig) -> Path:
    """Folder of what must survive a restart: the configured one, systemd's, or the user's."""
    if vehicle.state_folder is not None:
        return vehicle.state_folder
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given) / vehicle.name
    return user_folder("XDG_STATE_HOME") / vehicle.name
