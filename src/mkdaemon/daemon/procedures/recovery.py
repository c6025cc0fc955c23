"""Live parameter sets that a procedure left unproven: whose they are, when to try, what has become of them."""

from __future__ import annotations

from typing import Final, NamedTuple

from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.procedures.interlock import Interlock
from mkdaemon.daemon.procedures.journal import Journal, Note
from mkdaemon.link.link import Link
from mkdaemon.protocol.procedures.live_set import Recovered
from mkdaemon.telemetry.settings import OwedSet

RETRIES: Final = (2.0, 4.0, 8.0, 15.0)
"""Pauses between attempts; the last one repeats [s]."""


class _Aircraft(NamedTuple):
    """What tells one aircraft on the line from another."""

    openings: int
    firmware: str


class Recovery:
    """Keeps the notes that are left, and says which one to act on."""

    def __init__(self, journal: Journal, link: Link, facts: VehicleFacts, audit: Audit, interlock: Interlock) -> None:
        """Read what an earlier daemon left."""
        self._link, self._facts, self._audit, self._interlock = link, facts, audit, interlock
        self._others: dict[str, _Aircraft] = {}
        self._details: dict[str, str] = {}
        self._attempts = 0
        self._retry_at = 0.0
        self._here: _Aircraft | None = None
        self.notes, strange = journal.read()
        for path in strange:
            text = f"{path}: no note of a live set that can be read; kept, not applied: look at it before you fly"
            audit.log("warning", text)
        for note in self.notes:
            text = f"{_words(note)}: it is made live again when the FlightCtrl answers and the motors stand still"
            audit.log("warning", text)
        self._find_owed()

    def add(self, note: Note) -> None:
        """A procedure ended without proving the live set."""
        self.notes.append(note)
        self._details[note.id] = "the procedure that was cut off could not prove it"
        self._audit.log("error", f"{_words(note)}: do not fly before it is proven")
        self.retry()

    def retry(self) -> None:
        """Try at once, also with an aircraft that was taken for another one."""
        self._attempts, self._retry_at = 0, 0.0
        self._others.clear()
        self._find_owed()

    def forget(self, note: Note) -> None:
        """Drop a note, which may be gone already; the journal's file is the caller's to remove."""
        if note in self.notes:
            self.notes.remove(note)
        self._find_owed()

    def next_note(self, now: float) -> Note | None:
        """Return the note to act on now, if there is one and the FlightCtrl can be asked."""
        if not self.notes:
            return None
        self._identify_aircraft()
        note = self._interlock.owed
        if note is None or self._here is None or now < self._retry_at:
            return None
        if self._facts.motors_running(now) is not False:
            self._set_detail(note, "motors run, or their state is unknown")
            return None
        return note

    def attempt_ended(self, note: Note, found: Recovered) -> None:
        """An attempt came to its end."""
        if found is Recovered.OTHER_AIRCRAFT:
            if self._here is not None:
                self._set_aside(note, self._here, "its parameter sets are others")
        else:
            self.forget(note)
            how = "loaded again" if found is Recovered.LOADED else "written again"
            self._audit.log("warning", f"{_words(note)}: it has been {how} and is live, byte for byte as before")
        self._attempts, self._retry_at = 0, 0.0
        self._find_owed()

    def attempt_failed(self, note: Note, reason: str, now: float) -> None:
        """An attempt failed; another one follows."""
        self._retry_at = now + RETRIES[min(self._attempts, len(RETRIES) - 1)]
        self._attempts += 1
        if self._details.get(note.id) != reason:
            self._audit.log("error", f"{_words(note)}: {reason}")
        self._set_detail(note, reason)

    def list_notes(self) -> tuple[OwedSet, ...]:
        """Every note, for a client."""
        return tuple(
            OwedSet(
                **{name: getattr(note, name) for name in ("id", "verb", "holder", "stamp", "firmware", "active")},
                is_owed=note.id not in self._others,
                detail=self._details.get(note.id, "the FlightCtrl has not answered yet"),
            )
            for note in self.notes
        )

    def _identify_aircraft(self) -> None:
        """Notice another aircraft; one that was taken for another is looked at again after the port was reopened."""
        state, release = self._facts.link, self._link.dialect.fc_release
        is_known = self._link.is_up and state is not None and release is not None and not self._link.lacks_flightctrl
        here = _Aircraft(state.openings, str(release)) if is_known and state is not None else None
        if here == self._here:
            return
        self._here, self._attempts, self._retry_at = here, 0, 0.0
        if here is None:
            return
        self._others = {key: place for key, place in self._others.items() if place == here}
        for note in self.notes:
            if note.firmware != here.firmware and note.id not in self._others:
                self._set_aside(note, here, f"it is a FlightCtrl {here.firmware}, not {note.firmware}")
        self._find_owed()

    def _set_aside(self, note: Note, here: _Aircraft, why: str) -> None:
        self._others[note.id] = here
        detail = f"this is another aircraft ({why})"
        self._details[note.id] = detail
        self._audit.log("warning", f"{_words(note)}: {detail}; the note is kept for its own, nothing was written")

    def _set_detail(self, note: Note, detail: str) -> None:
        self._details[note.id] = detail
        self._find_owed()

    def _find_owed(self) -> None:
        owed = next((note for note in self.notes if note.id not in self._others), None)
        self._interlock.owed = owed
        if owed is not None:
            self._interlock.detail = self._details.get(owed.id, "the FlightCtrl has not answered yet")


def _words(note: Note) -> str:
    who = f" of {note.holder}" if note.holder else ""
    return f"parameter set {note.active} was live when {note.verb}{who} was cut off"
