"""The note of the flight under way: what a daemon that restarts in flight must know of a FlightCtrl it cannot ask.

One small file, `<state folder>/flight.json`, there while an aircraft flies behind a NaviCtrl. Whatever stands in it is
only offered: telemetry must show the same flight, and a client must confirm it. See docs/link.md.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mkdaemon.clock import Clock
from mkdaemon.daemon.audit import Audit
from mkdaemon.files import write_whole
from mkdaemon.foreignfiles import read_bytes
from mkdaemon.link.link import Link
from mkdaemon.link.session.knownflight import FlightMemory, FlightState, Sighting
from mkdaemon.protocol.boards import Board
from mkdaemon.protocol.evidence import ControlForm, Evidence
from mkdaemon.protocol.generations import Release
from mkdaemon.stamp import Stamp

NAME: Final = "flight.json"
LOOK: Final = 1.0
"""Time between two looks whether the flight has begun or ended [s]."""
REWRITE: Final = 30.0
"""A note is written again after this time: flying time and clock drift apart [s]."""
MOST_AGE: Final = 300.0
"""An older note is none [s]."""
_LONGEST: Final = 4096
"""A longer file is no note [bytes]."""
_U8 = Annotated[int, Field(ge=0, le=255)]
_U16 = Annotated[int, Field(ge=0, le=65535)]
_ReleaseNumbers = tuple[_U8, _U8, _U8]


class FlightNote(BaseModel):
    """Content of the file; anything else is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    version: Annotated[int, Field(ge=1, le=1)] = 1
    port: str
    stamp: Stamp
    navictrl: _ReleaseNumbers
    flightctrl: _ReleaseNumbers
    layout: str
    hardware: _U8 | None
    label_checksum: _U8 | None
    settings_revision: _U8 | None
    control_form: ControlForm | None
    flying_time: _U16
    used_mah: _U16
    home: tuple[int, int] | None

    @classmethod
    def of(cls, memory: FlightMemory, port: str, clock: Clock) -> FlightNote:
        """The note of what is known."""
        evidence, sighting = memory.evidence, memory.sighting
        return cls(
            port=port,
            stamp=clock.stamp(sighting.at),
            navictrl=evidence.releases[Board.NC],
            flightctrl=evidence.releases[Board.FC],
            layout=memory.layout,
            hardware=evidence.hardware,
            label_checksum=evidence.label_checksum,
            settings_revision=evidence.settings_revision,
            control_form=evidence.control_form,
            flying_time=round(sighting.flying_time),
            used_mah=sighting.used_mah,
            home=sighting.home,
        )

    def memory(self, clock: Clock) -> FlightMemory:
        """The remembered flight."""
        releases = {Board.NC: Release(*self.navictrl), Board.FC: Release(*self.flightctrl)}
        evidence = Evidence(
            releases=MappingProxyType(releases),
            hardware=self.hardware,
            label_checksum=self.label_checksum,
            settings_revision=self.settings_revision,
            control_form=self.control_form,
        )
        at = clock.monotonic_of(self.stamp)
        sighting = Sighting(at, FlightState.FLYING, float(self.flying_time), self.used_mah, self.home)
        return FlightMemory(evidence, self.layout, sighting)


class FlightNotes:
    """Keeps the note of one vehicle."""

    def __init__(self, folder: Path, port: str, clock: Clock) -> None:
        """Use a folder; it is made when the first note is taken."""
        self._path = folder / NAME
        self._port = port
        self._clock = clock

    def read(self) -> FlightMemory | None:
        """Return the note of an earlier daemon; None without a note, or if it cannot be trusted."""
        try:
            note = FlightNote.model_validate_json(read_bytes(self._path, _LONGEST), strict=True)
        except (OSError, ValidationError):
            return None
        memory = note.memory(self._clock)
        age = self._clock.now() - memory.sighting.at
        return memory if note.port == self._port and 0 <= age <= MOST_AGE else None

    def write(self, memory: FlightMemory) -> None:
        """Keep a note.

        Raises:
            OSError: it cannot be kept.
        """
        self._path.parent.mkdir(parents=True, exist_ok=True)
        note = FlightNote.of(memory, self._port, self._clock)
        write_whole(self._path, note.model_dump_json(indent=1) + "\n", overwrite=True)

    def discard(self) -> None:
        """Forget the note; one that is gone already is no error.

        Raises:
            OSError: it cannot be removed.
        """
        self._path.unlink(missing_ok=True)

    async def follow(self, link: Link, audit: Audit) -> None:
        """Keep the note up to date while the aircraft flies, for ever; a write error is reported once."""
        written_at: float | None = None
        may_exist, has_failed = True, False
        while True:
            memory, now = link.flight_memory, self._clock.now()
            try:
                if memory is None and may_exist:
                    await asyncio.to_thread(self.discard)
                    written_at, may_exist = None, False
                elif memory is not None and (written_at is None or now - written_at >= REWRITE):
                    await asyncio.to_thread(self.write, memory)
                    written_at, may_exist = now, True
                has_failed = False
            except OSError as error:
                if not has_failed:
                    audit.log("warning", f"what is known of the flight cannot be kept for a restart: {error}")
                has_failed = True
            await asyncio.sleep(LOOK)
