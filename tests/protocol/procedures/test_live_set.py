"""What belongs live is announced before it may change, and made live again after a procedure was cut off."""

from __future__ import annotations

import pytest

from mkdaemon.errors import ProtocolError, RequestTimeoutError
from mkdaemon.protocol.messages import SettingsRequest, WriteSettings
from mkdaemon.protocol.procedures import LiveSet, LiveSetAtRisk, LiveSetProven, Patience
from mkdaemon.protocol.procedures.live_set import Recovered, pad_set, recover_live_set
from mkdaemon.protocol.procedures.settings_slots import backup_settings, edit_settings, restore_settings

from .talk import FlightCtrl, drive

PATIENCE = Patience(2)


def changed(raw: bytes, value: int = 7) -> bytes:
    return raw[:30] + bytes((value,)) + raw[31:]


def note_of(board: FlightCtrl, **sets: bytes) -> LiveSet:
    """What a procedure would note: bytes as they are received, padding included."""
    writing = {int(slot[1:]): pad_set(raw) for slot, raw in sets.items()}
    return LiveSet("2.12a", board.active, pad_set(board.sets[board.active]), writing)


def test_the_live_set_is_announced_before_another_one_is_read_and_proven_in_the_end() -> None:
    board, steps = FlightCtrl(active=2), []
    drive(backup_settings(PATIENCE), board, steps)
    asked = [n for n, s in enumerate(steps) if isinstance(getattr(s, "message", None), SettingsRequest)]
    other = next(n for n in asked if steps[n].message.index not in {2, 255})
    risk = next(n for n, s in enumerate(steps) if isinstance(s, LiveSetAtRisk))
    proof = next(n for n, s in enumerate(steps) if isinstance(s, LiveSetProven))
    assert risk < other < asked[-1] < proof
    assert steps[risk].wanted == note_of(board)
    drive(backup_settings(PATIENCE, ()), board, alone := [])
    assert not any(isinstance(step, LiveSetAtRisk) for step in alone), "the active set puts nothing at risk"


def test_a_restore_announces_what_it_writes_before_it_writes() -> None:
    board, steps = FlightCtrl(active=2), []
    wanted = changed(board.sets[4])
    drive(restore_settings({4: wanted}, PATIENCE), board, steps)
    write = next(n for n, s in enumerate(steps) if isinstance(getattr(s, "message", None), WriteSettings))
    risk = [s for s in steps[:write] if isinstance(s, LiveSetAtRisk)][-1]
    assert set(risk.wanted.writing) == {2, 4}
    assert risk.wanted.writing[4] == pad_set(wanted)


def test_another_set_that_is_live_is_replaced_by_the_active_one() -> None:
    board = FlightCtrl(active=4)
    board.live = board.sets[1]
    steps = []
    assert drive(recover_live_set(note_of(board), PATIENCE), board, steps) is Recovered.LOADED
    assert board.live == board.sets[4]
    assert isinstance(steps[-2], LiveSetProven) or isinstance(steps[-1], LiveSetProven)


def test_a_set_that_a_restore_had_activated_is_replaced_by_the_right_one() -> None:
    board = FlightCtrl(active=4)
    before = dict(board.sets)
    wanted = changed(board.sets[1])
    note = note_of(board, _1=wanted, _4=board.sets[4])
    board.sets[1] = board.live = wanted
    board.active = 1
    assert drive(recover_live_set(note, PATIENCE), board) is Recovered.WRITTEN
    assert (board.active, board.live) == (4, before[4])
    assert board.sets == {**before, 1: wanted}


@pytest.mark.parametrize("written", [3, 40, 72, 140, 144])
def test_an_active_set_that_was_written_in_part_or_whole_gets_its_old_bytes(written: int) -> None:
    board = FlightCtrl(active=4)
    before = board.sets[4]
    wanted = before[:2] + bytes(byte ^ 0x55 for byte in before[2:])
    note = note_of(board, _4=wanted)
    board.sets[4] = board.live = wanted[:written] + before[written:]
    assert drive(recover_live_set(note, PATIENCE), board) is Recovered.WRITTEN
    assert board.live == board.sets[4] == before


@pytest.mark.parametrize("case", ["release", "active set", "bytes", "old set", "nothing was written"])
def test_another_aircraft_is_recognised_and_nothing_is_written_to_it(case: str) -> None:
    board = FlightCtrl(active=4)
    note = note_of(board, _1=changed(board.sets[1]), _4=board.sets[4])
    far = board.sets[1][:60] + bytes(range(1, 21)) + board.sets[1][80:]
    match case:
        case "release":
            note = LiveSet("2.08a", 4, board.sets[4], {})
        case "active set":
            board.active, board.live = 2, board.sets[2]
        case "bytes":
            board.sets[1], board.active = far, 1
        case "old set":
            board.sets[1], board.active, board.sets[4] = changed(board.sets[1]), 1, far
        case _:
            note = note_of(board)
            board.sets[4] = far
    before, active = dict(board.sets), board.active
    steps = []
    assert drive(recover_live_set(note, PATIENCE), board, steps) is Recovered.OTHER_AIRCRAFT
    assert (board.sets, board.active) == (before, active)
    assert not any(isinstance(step, LiveSetProven) for step in steps)
    if case != "release":
        assert board.live == board.sets[active]


def test_a_recovery_without_an_answer_says_so() -> None:
    with pytest.raises(RequestTimeoutError):
        drive(recover_live_set(note_of(FlightCtrl()), PATIENCE), lambda message: None)


def test_a_set_that_cannot_be_changed_is_not_left_live() -> None:
    board = FlightCtrl(active=2)

    def change(raw: bytes) -> bytes:
        raise ProtocolError("no such parameter")

    with pytest.raises(ProtocolError):
        drive(edit_settings(5, change, PATIENCE), board)
    assert board.live == board.sets[2]


def test_an_edit_changes_one_set_and_a_dry_run_shows_it() -> None:
    board = FlightCtrl(active=2)
    before = dict(board.sets)
    shown = drive(edit_settings(5, changed, PATIENCE, dry_run=True), board)
    assert (board.sets, shown.written, shown.stored[5][30]) == (before, (), 7)
    done = drive(edit_settings(None, changed, PATIENCE), board)
    assert (done.written, board.live[30], board.active) == ((2,), 7, 2)
