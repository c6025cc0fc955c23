"""Parameter sets of a FlightCtrl: back up and restore, with proof of what is live afterwards.

Reading a set that is not active loads it into the live parameters, and writing one activates it. So a backup ends with
the active set read again, which makes it live, and compared byte for byte with the first reading; a restore ends with
the set that was active before written last. Both must only run while the motors stand still: a 2.12a with running
motors answers every reading with the set in use. Sources: docs/protocol.md, "FlightCtrl commands";
docs/firmware-notes, "Side effects".

Bytes are as they cross the line: revision first, zero padding behind the last field kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mkdaemon.errors import MkError, RequestTimeoutError
from mkdaemon.protocol.framing import padded_length
from mkdaemon.protocol.generations import Release, fc_generation
from mkdaemon.protocol.messages import Settings, SettingsRequest, SettingsWritten, WriteSettings
from mkdaemon.protocol.procedures.failures import fail
from mkdaemon.protocol.procedures.labels import Version, read_version
from mkdaemon.protocol.procedures.steps import (
    Patience,
    Pause,
    Procedure,
    Progress,
    Question,
    insist,
    insist_twice,
)
from mkdaemon.protocol.settings import layout_of
from mkdaemon.protocol.wire import Board

SLOTS = (1, 2, 3, 4, 5)
ACTIVE = 255
"""Index that asks for the active set."""
_WRITE_TIMEOUT = 2.5
"""A write takes 0.3 to 0.6 s and the FlightCtrl beeps afterwards; source: docs/firmware-notes, "Timing" [s]."""
_DEAF = 2.0
"""Quiet time after a write: the FlightCtrl beeps the set's number and hears nothing for 1.33 s [s]."""
_WRITES = 3
_STUBBORN = 5
"""So many times the patience for the proof that the live set is what it was: giving up there costs the most."""


@dataclass(frozen=True, slots=True)
class Backup:
    """All parameter sets of a FlightCtrl.

    Attributes:
        version: what it said of itself.
        active: number of the active set; it is live again, proven.
        sets: bytes of each set by number.
    """

    version: Version
    active: int
    sets: Mapping[int, bytes]


@dataclass(frozen=True, slots=True)
class Restoration:
    """What a restore found, wrote and left.

    Attributes:
        version: what the FlightCtrl said of itself.
        active: number of the active set, before and after.
        before: bytes of each set concerned, as found.
        stored: bytes of each set concerned, read back afterwards; as found in a dry run.
        written: numbers of the sets written, in order.
    """

    version: Version
    active: int
    before: Mapping[int, bytes]
    stored: Mapping[int, bytes]
    written: tuple[int, ...]


@dataclass(slots=True)
class _Session:
    """The FlightCtrl as found, and how to leave it."""

    version: Version
    active: int
    live: bytes
    patience: Patience
    sets: dict[int, bytes] = field(default_factory=dict)


def read_active(patience: Patience) -> Procedure[tuple[int, bytes]]:
    """Read the active set: its number and bytes.

    Raises:
        RequestTimeoutError: no answer.
    """
    answer = yield from insist_twice(_read(ACTIVE), patience)
    return answer.index, answer.parameters


def backup_settings(patience: Patience, slots: tuple[int, ...] = SLOTS) -> Procedure[Backup]:
    """Read parameter sets; the active one is live again afterwards, proven by comparing bytes.

    Args:
        patience: how long to insist on each answer.
        slots: sets to read; the active one is read in any case.

    Raises:
        RequestTimeoutError: no answer; the active set was made live again all the same.
        CommandRejectedError: `live_set_changed`, `live_set_unproven` or `active_set_moved`: do not fly.
    """
    session = yield from _open(patience)
    yield from _collect(session, slots)
    yield Progress(len(slots), len(slots) + 1, "proving the live set")
    yield from _make_live(session)
    yield Progress(len(slots) + 1, len(slots) + 1, "proven")
    return Backup(session.version, session.active, dict(sorted(session.sets.items())))


def restore_settings(
    wanted: Mapping[int, bytes], patience: Patience, *, dry_run: bool = False
) -> Procedure[Restoration]:
    """Write parameter sets that differ, read each back, and leave the set active that was.

    What the FlightCtrl changed of its own accord is no failure: compare `wanted` with `Restoration.stored`.

    Args:
        wanted: bytes of each set to restore, by number 1..5.
        patience: how long to insist on each answer.
        dry_run: read and compare only.

    Raises:
        RequestTimeoutError: no answer; the set that was active has been made live again.
        CommandRejectedError: `unknown_revision`, `revision_differs`, `length_differs` (nothing was written),
            `write_refused`, `live_set_changed`, `live_set_unproven` or `active_set_moved`.
    """
    session = yield from _open(patience)
    _check_known(session)
    for raw in wanted.values():
        _check(raw, session.live)
    yield from _collect(session, tuple(sorted(wanted)))
    before = {slot: session.sets[slot] for slot in sorted(wanted)}
    todo = [slot for slot in before if _padded(wanted[slot]) != before[slot]]
    if dry_run or not todo:
        yield from _make_live(session)
        return Restoration(session.version, session.active, before, before, ())
    # The active set comes last, also unchanged, because every write activates what it writes.
    order = [*(slot for slot in todo if slot != session.active), session.active]
    stored = dict(before)
    try:
        for done, slot in enumerate(order):
            yield Progress(done, len(order) + 1, f"writing set {slot}")
            stored[slot] = yield from _write(slot, wanted.get(slot, session.live), patience)
    except MkError as cause:
        yield from _write_back(session, cause)
        raise
    session.live = stored[session.active]
    yield Progress(len(order), len(order) + 1, "proving the live set")
    yield from _make_live(session)
    yield Progress(len(order) + 1, len(order) + 1, "proven")
    kept = {slot: stored[slot] for slot in before}
    return Restoration(session.version, session.active, before, kept, tuple(order))


def differing(wanted: bytes, stored: bytes) -> tuple[int, ...]:
    """Offsets at which two parameter sets differ, the padding of either ignored."""
    wanted, stored = _padded(wanted), _padded(stored)
    longest = max(len(wanted), len(stored))
    pairs = zip(wanted.ljust(longest, b"\0"), stored.ljust(longest, b"\0"), strict=True)
    return tuple(offset for offset, (a, b) in enumerate(pairs) if a != b)


def _open(patience: Patience) -> Procedure[_Session]:
    version = yield from read_version(Board.FC, patience)
    active, live = yield from read_active(patience)
    return _Session(version, active, live, patience, {active: live})


def _collect(session: _Session, slots: tuple[int, ...]) -> Procedure[None]:
    """Read sets; whatever happens, the active one is made live again."""
    try:
        for done, slot in enumerate(slots):
            yield Progress(done, len(slots) + 1, f"reading set {slot}")
            if slot not in session.sets:
                session.sets[slot] = (yield from insist_twice(_read(slot), session.patience)).parameters
    except MkError as cause:
        try:
            yield from _load_live(session)
        except RequestTimeoutError as second:
            raise fail("live_set_unproven", cause=f"{cause}; then {second}", slot=session.active) from second
        raise


def _make_live(session: _Session) -> Procedure[None]:
    """Make the active set live, and prove that it is what it was and still the active one."""
    try:
        yield from _load_live(session)
        present = (yield from insist(_read(ACTIVE), session.patience)).index
    except RequestTimeoutError as cause:
        raise fail("live_set_unproven", cause=cause, slot=session.active) from cause
    if present != session.active:
        raise fail("active_set_moved", present=present, wanted=session.active)


def _load_live(session: _Session) -> Procedure[None]:
    """Read the active set, which loads it, and compare it with the first reading; twice, for a damaged answer."""
    stubborn = Patience(_STUBBORN * session.patience.attempts, session.patience.timeout)
    for _ in range(2):
        found = (yield from insist(_read(session.active), stubborn)).parameters
        if found == session.live:
            return
    where = ", ".join(f"byte {offset}" for offset in differing(session.live, found))
    raise fail("live_set_changed", slot=session.active, where=where)


def _write(slot: int, raw: bytes, patience: Patience) -> Procedure[bytes]:
    """Write one set and read it back; a difference that comes twice is the FlightCtrl's own will."""
    slow = Patience(patience.attempts, max(patience.timeout, _WRITE_TIMEOUT))
    before: bytes | None = None
    for _ in range(_WRITES):
        written = yield from insist(_store(slot, raw), slow)
        if written.index == 0:
            raise fail("write_refused", slot=slot)
        yield Pause(_DEAF)
        stored = (yield from insist_twice(_read(slot), patience)).parameters
        if stored in (_padded(raw), before):
            break
        before = stored
    return stored


def _write_back(session: _Session, cause: MkError) -> Procedure[None]:
    """After a failed restore: see that the set that was active still is, as it was, or write it so."""
    try:
        if (yield from read_active(session.patience)) == (session.active, session.live):
            return
        stored = yield from _write(session.active, session.live, session.patience)
    except MkError as second:
        raise fail("live_set_unproven", cause=f"{cause}; then {second}", slot=session.active) from second
    if stored != session.live:
        raise fail("live_set_changed", slot=session.active, where=f"after {cause}")


def _check_known(session: _Session) -> None:
    """Writing needs a revision whose layout is known and that belongs to the FlightCtrl's release."""
    version, revision = session.version, session.live[0]
    generation = fc_generation(Release(version.major, version.minor, version.patch))
    if layout_of(revision) is None or generation is None or revision not in generation.revisions:
        raise fail("unknown_revision", revision=revision, size=len(session.live), release=version.release)


def _check(raw: bytes, live: bytes) -> None:
    if raw[:1] != live[:1]:
        raise fail("revision_differs", wanted=raw[0] if raw else "no", present=live[0])
    if len(_padded(raw)) != len(live):
        raise fail("length_differs", wanted=len(raw), present=len(live))


def _padded(raw: bytes) -> bytes:
    """A set as it is received: index and set together padded to a multiple of three."""
    return raw.ljust(padded_length(1 + len(raw)) - 1, b"\0")


def _read(index: int) -> Question[Settings]:
    what = "read the active set" if index == ACTIVE else f"read set {index}"
    wanted = SLOTS if index == ACTIVE else (index,)
    return Question(Board.FC, SettingsRequest(index=index), (Settings,), lambda s: s.index in wanted, what)


def _store(slot: int, raw: bytes) -> Question[SettingsWritten]:
    request = WriteSettings(index=slot, parameters=raw)
    return Question(Board.FC, request, (SettingsWritten,), lambda s: s.index in (0, slot), f"write set {slot}")
