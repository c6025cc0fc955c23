"""Events of the waypoint list, and a note while an upload may leave it half written."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from pydantic import BaseModel, ConfigDict, ValidationError

from mkdaemon.clock import Clock
from mkdaemon.daemon.audit import Audit, Outlet
from mkdaemon.daemon.procedures.journal import Journal
from mkdaemon.files import flush_folder, write_whole
from mkdaemon.foreignfiles import LONGEST_TEXT, read_bytes
from mkdaemon.link.procedures import Observer
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.mission import MissionEvent, WaypointsStored

_FILE: Final = "waypoint-list.json"
_WRITES: Final = "write_waypoint"
"""Requests that change the list, in every layout."""


class ListNote(BaseModel):
    """An upload or clearing that has begun."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    verb: str
    """What it is."""
    holder: str
    """The client that asked for it."""
    source: str
    """Where the points came from."""
    t_wall: float
    """When it began, Unix time [s]."""


class WaypointListKeeper:
    """Publishes `event/mission`, and keeps the note of the list that is being written.

    The note goes when a list was stored or cleared and read back.
    """

    def __init__(self, journal: Journal, audit: Audit, bus: Outlet, clock: Clock) -> None:
        """Find what an earlier daemon left beside the journal."""
        self._path = journal.folder / _FILE
        self._disk = journal.disk
        self._audit, self._bus, self._clock = audit, bus, clock

    def announce(self) -> None:
        """Tell what an earlier daemon left."""
        if self._path.exists():
            self._warn(self._words())

    def watch(self, observer: Observer, verb: str, holder: str, source: str) -> ListWrites:
        """Return an observer that keeps the note before the first write: what writes nothing touches no note."""
        return ListWrites(observer, lambda: self._begin(verb, holder, source))

    async def _begin(self, verb: str, holder: str, source: str) -> None:
        """Keep a note; a folder that cannot be written is announced, and no reason to refuse an upload."""
        note = ListNote(verb=verb, holder=holder, source=source, t_wall=self._clock.stamp().wall)
        try:
            await asyncio.get_running_loop().run_in_executor(self._disk, self._write, note)
        except OSError as error:
            self._audit.log("warning", f"{self._path}: cannot be written ({error.strerror or error})")

    async def stored(self, reply: WaypointsStored, source: str) -> None:
        """A list was read back: the note goes."""
        await self._end()
        self.publish("uploaded" if reply.count else "cleared", source, count=reply.count, digest=reply.digest)

    def broke_off(self, source: str) -> None:
        """An upload or clearing has failed after its first write."""
        self._warn("the NaviCtrl's list may be incomplete", source)

    def publish(self, action: str, source: str = "", *, count: int = 0, digest: str = "") -> None:
        """Publish what became of the list."""
        event = MissionEvent(stamp=self._clock.stamp(), action=action, count=count, digest=digest, source=source)
        self._bus.publish("event/mission", event)

    def _warn(self, what: str, source: str = "") -> None:
        self.publish("incomplete", source)
        self._audit.log("warning", f"{what}: do not fly the list before it was uploaded again or cleared")

    async def _end(self) -> None:
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


class ListWrites:
    """Hands everything on to another observer, and announces the first write to the list.

    Attributes:
        may_be_changed: the list may have been changed.
    """

    def __init__(self, observer: Observer, begin: Callable[[], Awaitable[None]]) -> None:
        self.may_be_changed = False
        self._begin = begin
        self._check = observer.check
        self.progress, self.prove = observer.progress, observer.prove
        self.live_set_at_risk, self.live_set_proven = observer.live_set_at_risk, observer.live_set_proven

    async def check(self, board: Board, message: WireMessage) -> None:
        """Let a request pass or refuse it; see `Observer`."""
        await self._check(board, message)
        if message.spec.key == _WRITES and not self.may_be_changed:
            self.may_be_changed = True
            await self._begin()
