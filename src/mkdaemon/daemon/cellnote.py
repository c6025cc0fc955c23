"""Number of the battery's cells: configured, or remembered from a battery that showed it beyond doubt.

One small file, `<state folder>/battery.json`. A FlightCtrl counts the cells by the voltage alone, and takes a battery
of four cells that rests at 12.8 V for one of three.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mkdaemon.control.events import CellsKnown
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.daemon.audit import Audit
from mkdaemon.files import write_whole
from mkdaemon.foreignfiles import read_bytes

NAME: Final = "battery.json"
LOOK: Final = 5.0
"""Time between two looks whether the cells are certain [s]."""
_LONGEST: Final = 256
"""A longer file is no note [bytes]."""


class CellNote(BaseModel):
    """Content of the file; anything else is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    version: Annotated[int, Field(ge=1, le=1)] = 1
    cells: Annotated[int, Field(ge=1, le=14)]


class CellNotes:
    """Keeps the note of one vehicle."""

    def __init__(self, folder: Path, configured: int | None) -> None:
        """Use a folder, and what the configuration says."""
        self._path, self._configured = folder / NAME, configured

    def read(self) -> int | None:
        """Return how many cells the battery has; None where that is neither configured nor remembered."""
        if self._configured is not None:
            return self._configured
        try:
            return CellNote.model_validate_json(read_bytes(self._path, _LONGEST), strict=True).cells
        except (OSError, ValidationError):
            return None

    def write(self, cells: int) -> None:
        """Remember how many cells the battery has.

        Raises:
            OSError: it cannot be kept.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._path, CellNote(cells=cells).model_dump_json() + "\n", overwrite=True)

    async def follow(self, facts: VehicleFacts, feed: Callable[[CellsKnown], None], audit: Audit) -> None:
        """Let the flight core know the cells, and remember those that a battery shows, for ever."""
        known = self.read()
        if known is not None:
            feed(CellsKnown(known))
        has_failed = False
        while True:
            certain = facts.certain_cells
            if self._configured is None and certain is not None and certain != known:
                try:
                    await asyncio.to_thread(self.write, certain)
                    known, has_failed = certain, False
                    feed(CellsKnown(certain))
                except OSError as error:
                    if not has_failed:
                        audit.log("warning", f"the number of battery cells cannot be kept for a restart: {error}")
                    has_failed = True
            await asyncio.sleep(LOOK)
