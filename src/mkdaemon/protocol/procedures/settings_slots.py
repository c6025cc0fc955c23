"""Parameter sets of a FlightCtrl: back up, restore and edit, with proof of what is live afterwards (`live_set`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mkdaemon.errors import MkError
from mkdaemon.protocol.generations import Release, fc_generation
from mkdaemon.protocol.procedures.labels import Version
from mkdaemon.protocol.procedures.live_set import (
    SLOTS,
    FoundSets,
    collect_sets,
    make_live,
    open_sets,
    pad_set,
    write_back,
    write_set,
)
from mkdaemon.protocol.procedures.steps import LiveSetAtRisk, LiveSetProven, Patience, Procedure, Progress
from mkdaemon.protocol.settings import layout_of
from mkdaemon.telemetry.refusals import Token, refuse


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
    """Result of a restore: sets found, written, unchanged.

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


def backup_settings(patience: Patience, slots: tuple[int, ...] = SLOTS) -> Procedure[Backup]:
    """Read parameter sets; the active one is live again afterwards, proven by comparing bytes.

    Args:
        patience: how long to insist on each answer.
        slots: sets to read; the active one is read in any case.

    Raises:
        RequestTimeoutError: no answer; the active set was made live again all the same.
        CommandRejectedError: `live_set_changed`, `live_set_unproven` or `active_set_moved`: do not fly.
    """
    session = yield from open_sets(patience)
    yield from collect_sets(session, slots)
    yield Progress(len(slots), len(slots) + 1, "proving the live set")
    yield from make_live(session)
    yield Progress(len(slots) + 1, len(slots) + 1, "proven")
    return Backup(session.version, session.active, dict(sorted(session.sets.items())))


def restore_settings(
    wanted: Mapping[int, bytes], patience: Patience, *, dry_run: bool = False
) -> Procedure[Restoration]:
    """Write parameter sets that differ, read each back, and leave the set active that was.

    A change by the FlightCtrl itself is no failure: compare `wanted` with `Restoration.stored`.

    Args:
        wanted: bytes of each set to restore, by number 1..5.
        patience: how long to insist on each answer.
        dry_run: read and compare only.

    Raises:
        RequestTimeoutError: no answer; the set that was active has been made live again.
        CommandRejectedError: `unknown_revision`, `revision_differs`, `length_differs` (nothing was written),
            `write_refused`, `live_set_changed`, `live_set_unproven` or `active_set_moved`.
    """
    session = yield from open_sets(patience)
    _check_known(session)
    for raw in wanted.values():
        _check(raw, session.live)
    yield from collect_sets(session, tuple(sorted(wanted)))
    return (yield from _replace(session, wanted, dry_run=dry_run))


def edit_settings(
    slot: int | None, change: Callable[[bytes], bytes], patience: Patience, *, dry_run: bool = False
) -> Procedure[Restoration]:
    """Read one parameter set, change it, write and read it back, and leave the set active that was.

    Args:
        slot: number of the set; None for the active one.
        change: makes the new bytes from those found; an `MkError` of it ends the procedure with the live set proven.
        patience: how long to insist on each answer.
        dry_run: read and compare only; `Restoration.stored` is then the set as it would be written.

    Raises:
        MkError: what `change` raised.
        RequestTimeoutError: no answer; the set that was active has been made live again.
        CommandRejectedError: as `restore_settings`.
    """
    session = yield from open_sets(patience)
    _check_known(session)
    number = session.active if slot is None else slot
    yield from collect_sets(session, (number,))
    try:
        wanted = {number: change(session.sets[number])}
    except MkError:
        yield from make_live(session)
        raise
    done = yield from _replace(session, wanted, dry_run=dry_run)
    if dry_run:
        return Restoration(done.version, done.active, done.before, {number: pad_set(wanted[number])}, ())
    return done


def _replace(session: FoundSets, wanted: Mapping[int, bytes], *, dry_run: bool) -> Procedure[Restoration]:
    """Write what differs from the sets collected, the active one last, and prove the live set."""
    before = {slot: session.sets[slot] for slot in sorted(wanted)}
    todo = [slot for slot in before if pad_set(wanted[slot]) != before[slot]]
    if dry_run or not todo:
        yield from make_live(session)
        return Restoration(session.version, session.active, before, before, ())
    # The active set comes last, also unchanged, because every write activates what it writes.
    order = [*(slot for slot in todo if slot != session.active), session.active]
    writing = {slot: pad_set(wanted.get(slot, session.live)) for slot in order}
    try:
        yield LiveSetAtRisk(session.live_set(writing))
    except MkError:
        yield from make_live(session)  # collecting the sets may have loaded another one
        raise
    stored = dict(before)
    parts = 2 * len(order) + 1
    try:
        for index, slot in enumerate(order):
            yield Progress(2 * index, parts, f"writing set {slot}")
            has_stored = Progress(2 * index + 1, parts, f"reading back set {slot}")
            stored[slot] = yield from write_set(slot, writing[slot], session.patience, has_stored)
    except MkError as cause:
        yield from write_back(session, cause)
        yield LiveSetProven()
        raise
    session.live = stored[session.active]
    yield Progress(parts - 1, parts, "proving the live set")
    yield from make_live(session)
    yield Progress(parts, parts, "proven")
    kept = {slot: stored[slot] for slot in before}
    return Restoration(session.version, session.active, before, kept, tuple(order))


def _check_known(session: FoundSets) -> None:
    """Writing needs a revision whose layout is known and that belongs to the FlightCtrl's release."""
    version, revision = session.version, session.live[0]
    generation = fc_generation(Release(version.major, version.minor, version.patch))
    if layout_of(revision) is None or generation is None or revision not in generation.revisions:
        raise refuse(Token.UNKNOWN_REVISION, revision=revision, size=len(session.live), release=version.release)


def _check(raw: bytes, live: bytes) -> None:
    if raw[:1] != live[:1]:
        raise refuse(Token.REVISION_DIFFERS, wanted=raw[0] if raw else "no", present=live[0])
    if len(pad_set(raw)) != len(live):
        raise refuse(Token.LENGTH_DIFFERS, wanted=len(raw), present=len(live))
