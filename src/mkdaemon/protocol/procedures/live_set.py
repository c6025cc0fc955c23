"""The live parameter set of a FlightCtrl: what may change it, and how a procedure leaves it as it found it.

Reading a set that is not active loads it into the live parameters, and writing one activates it. A procedure that
reads or writes sets announces it first (`LiveSetAtRisk`), ends with the active set read again, which makes it live,
and compares it byte for byte with the first reading. Motors must stand still: a 2.12a with running motors answers every
reading with the set in use. Sources: docs/protocol.md, "FlightCtrl commands"; docs/firmware-notes, "Side effects".

Bytes are as they cross the line: revision first, zero padding behind the last field kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from mkdaemon.errors import MkError
from mkdaemon.protocol.framing import padded_length
from mkdaemon.protocol.messages import ACTIVE_SET, Settings, SettingsRequest, SettingsWritten, WriteSettings
from mkdaemon.protocol.procedures.labels import Version, read_version
from mkdaemon.protocol.procedures.steps import (
    LiveSet,
    LiveSetAtRisk,
    LiveSetProven,
    Patience,
    Pause,
    Procedure,
    Progress,
    Question,
    insist,
    insist_twice,
)
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.refusals import Token, refuse

SLOTS = (1, 2, 3, 4, 5)
_DEAF = 2.0
"""Quiet time after a write: the FlightCtrl beeps the set's number and hears nothing for 1.33 s [s]."""
_WRITES = 3
_STUBBORN = 5
"""Factor of the patience for the proof that the live set is what it was: giving up there costs the most."""
_CLAMPED = 8
"""Largest number of bytes of a set that a FlightCtrl clamps when it stores it."""


class Recovered(Enum):
    """Way in which a live set was recovered."""

    LOADED = "loaded"
    """The FlightCtrl had it stored and has loaded it."""
    WRITTEN = "written"
    """It was written again: a procedure had been cut off while it wrote."""
    OTHER_AIRCRAFT = "other aircraft"
    """Not at all: another release, or sets that the procedure cannot have left behind."""


@dataclass(slots=True)
class FoundSets:
    """The sets of a FlightCtrl as found, and how to leave it.

    Attributes:
        version: what it said of itself.
        active: number of the active set.
        live: bytes of the active set, which must be live in the end.
        patience: how long to insist on each answer.
        sets: bytes of every set already read, by number.
        is_at_risk: another set may be live.
    """

    version: Version
    active: int
    live: bytes
    patience: Patience
    sets: dict[int, bytes] = field(default_factory=dict)
    is_at_risk: bool = False

    def live_set(self, writing: Mapping[int, bytes]) -> LiveSet:
        """The set that must be live at the end."""
        return LiveSet(self.version.release, self.active, self.live, writing)


def read_active(patience: Patience) -> Procedure[tuple[int, bytes]]:
    """Read the active set: its number and bytes.

    Raises:
        RequestTimeoutError: no answer.
    """
    answer = yield from insist_twice(_read(ACTIVE_SET), patience)
    return answer.index, answer.parameters


def recover_live_set(lost: LiveSet, patience: Patience) -> Procedure[Recovered]:
    """Make the set live again that was live when another procedure was cut off.

    Returns:
        How; nothing is written to another aircraft than the one that lost its set.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `write_refused`, `live_set_changed`, `live_set_unproven`, `active_set_moved`: do not fly.
    """
    version = yield from read_version(Board.FC, patience)
    if version.release != lost.firmware:
        return Recovered.OTHER_AIRCRAFT
    yield Progress(0, 2, f"making set {lost.active} live")
    active, live = yield from read_active(patience)
    is_same = (active, live) == (lost.active, lost.live)
    if not is_same:
        if not (yield from _is_same_aircraft(lost, active, live, patience)):
            return Recovered.OTHER_AIRCRAFT
        stored = yield from write_set(lost.active, lost.live, patience)
        if stored != lost.live:
            raise refuse(Token.LIVE_SET_CHANGED, slot=lost.active, where=_places(lost.live, stored))
    yield Progress(1, 2, "proving the live set")
    yield from make_live(FoundSets(version, lost.active, lost.live, patience))
    yield Progress(2, 2, "proven")
    return Recovered.LOADED if is_same else Recovered.WRITTEN


def _is_same_aircraft(lost: LiveSet, active: int, live: bytes, patience: Patience) -> Procedure[bool]:
    """Whether what is active can be what the procedure that was cut off has written."""
    if not _is_half_written(lost, active, live):
        return False
    if active == lost.active:
        return True
    stored = (yield from insist_twice(_read(lost.active), patience)).parameters
    if stored == lost.live or _is_half_written(lost, lost.active, stored):
        return True
    yield from insist(_read(ACTIVE_SET), patience)
    return False


def _is_half_written(lost: LiveSet, slot: int, found: bytes) -> bool:
    """Whether a set is what was to be written, or, where the power failed meanwhile, that and the old one in parts."""
    wanted = lost.writing.get(slot)
    if wanted is None or found[:1] != wanted[:1]:
        return False
    strange = differing(wanted, found)
    is_mixed = slot == lost.active and not set(strange) & set(differing(lost.live, found))
    return is_mixed or len(strange) <= _CLAMPED


def differing(wanted: bytes, stored: bytes) -> tuple[int, ...]:
    """Offsets at which two parameter sets differ, the padding of either ignored."""
    wanted, stored = pad_set(wanted), pad_set(stored)
    longest = max(len(wanted), len(stored))
    pairs = zip(wanted.ljust(longest, b"\0"), stored.ljust(longest, b"\0"), strict=True)
    return tuple(offset for offset, (a, b) in enumerate(pairs) if a != b)


def open_sets(patience: Patience) -> Procedure[FoundSets]:
    """Ask for the release and the active set, which changes nothing.

    Raises:
        RequestTimeoutError: no answer.
    """
    version = yield from read_version(Board.FC, patience)
    active, live = yield from read_active(patience)
    return FoundSets(version, active, live, patience, {active: live})


def collect_sets(session: FoundSets, slots: tuple[int, ...]) -> Procedure[None]:
    """Read sets; when that fails, the active one is made live again.

    Raises:
        RequestTimeoutError: no answer; the live set is proven.
        CommandRejectedError: `live_set_changed` or `live_set_unproven`: do not fly.
    """
    try:
        for done, slot in enumerate(slots):
            yield Progress(done, len(slots) + 1, f"reading set {slot}")
            if slot not in session.sets:
                if not session.is_at_risk:
                    session.is_at_risk = True
                    yield LiveSetAtRisk(session.live_set({}))
                session.sets[slot] = (yield from insist_twice(_read(slot), session.patience)).parameters
    except MkError as cause:
        try:
            changed = yield from _load_live(session)
        except MkError as second:
            raise refuse(Token.LIVE_SET_UNPROVEN, cause=f"{cause}; then {second}", slot=session.active) from second
        if changed:
            raise refuse(Token.LIVE_SET_CHANGED, slot=session.active, where=changed) from cause
        yield LiveSetProven()
        raise


def make_live(session: FoundSets) -> Procedure[None]:
    """Make the active set live, and prove that it is what it was and still the active one.

    Raises:
        CommandRejectedError: `live_set_changed`, `live_set_unproven` or `active_set_moved`: do not fly.
    """
    try:
        changed = yield from _load_live(session)
        present = (yield from insist(_read(ACTIVE_SET), session.patience)).index
    except MkError as cause:
        raise refuse(Token.LIVE_SET_UNPROVEN, cause=cause, slot=session.active) from cause
    if changed:
        raise refuse(Token.LIVE_SET_CHANGED, slot=session.active, where=changed)
    if present != session.active:
        raise refuse(Token.ACTIVE_SET_MOVED, present=present, wanted=session.active)
    yield LiveSetProven()


def _load_live(session: FoundSets) -> Procedure[str]:
    """Read the active set, which loads it; returns where it is not as at first, read twice for a damaged answer."""
    stubborn = Patience(_STUBBORN * session.patience.attempts, session.patience.timeout)
    for _ in range(2):
        found = (yield from insist(_read(session.active), stubborn)).parameters
        if found == session.live:
            return ""
    return _places(session.live, found)


def _places(wanted: bytes, stored: bytes) -> str:
    return ", ".join(f"byte {offset}" for offset in differing(wanted, stored))


def write_set(slot: int, raw: bytes, patience: Patience, stored_step: Progress | None = None) -> Procedure[bytes]:
    """Write one set and read it back; a difference that comes twice is what the FlightCtrl makes of it.

    Args:
        slot: number of the set.
        raw: its bytes.
        patience: how long to insist on each answer.
        stored_step: reported when the FlightCtrl has answered that it has stored the set, seconds before it can be
            read back.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `write_refused`.
    """
    slow = Patience(patience.attempts, max(patience.timeout, WriteSettings.spec.policy(Board.FC).timeout))
    before: bytes | None = None
    for _ in range(_WRITES):
        written = yield from insist(_store(slot, raw), slow)
        if written.index == 0:
            raise refuse(Token.WRITE_REFUSED, slot=slot)
        if stored_step is not None:
            yield stored_step
        yield Pause(_DEAF)
        stored = (yield from insist_twice(_read(slot), patience)).parameters
        if stored in (pad_set(raw), before):
            break
        before = stored
    return stored


def write_back(session: FoundSets, cause: MkError) -> Procedure[None]:
    """After a failed restore: see that the set that was active still is, as it was, or write it so.

    Raises:
        CommandRejectedError: `live_set_changed` or `live_set_unproven`: do not fly.
    """
    try:
        if (yield from read_active(session.patience)) == (session.active, session.live):
            return
        stored = yield from write_set(session.active, session.live, session.patience)
    except MkError as second:
        raise refuse(Token.LIVE_SET_UNPROVEN, cause=f"{cause}; then {second}", slot=session.active) from second
    if stored != session.live:
        raise refuse(Token.LIVE_SET_CHANGED, slot=session.active, where=f"after {cause}")


def pad_set(raw: bytes) -> bytes:
    """Return a set as it is received: index and set together padded to a multiple of three."""
    return raw.ljust(padded_length(1 + len(raw)) - 1, b"\0")


def _read(index: int) -> Question[Settings]:
    what = "read the active set" if index == ACTIVE_SET else f"read set {index}"
    wanted = SLOTS if index == ACTIVE_SET else (index,)
    return Question(Board.FC, SettingsRequest(index=index), (Settings,), lambda s: s.index in wanted, what)


def _store(slot: int, raw: bytes) -> Question[SettingsWritten]:
    request = WriteSettings(index=slot, parameters=raw)
    return Question(Board.FC, request, (SettingsWritten,), lambda s: s.index in (0, slot), f"write set {slot}")
