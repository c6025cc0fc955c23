from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mkdaemon.errors import CommandRejectedError, MkError, ProtocolError, RequestTimeoutError
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mkdaemon.protocol.generations import FC_GENERATIONS
from mkdaemon.protocol.messages import Settings, SettingsRequest, WriteSettings
from mkdaemon.protocol.procedures import LiveSet, LiveSetAtRisk, LiveSetProven, Patience
from mkdaemon.protocol.procedures.live_set import Recovered, differing, pad_set, recover_live_set, write_set
from mkdaemon.protocol.procedures.settings_slots import backup_settings, edit_settings, restore_settings
from mkdaemon.protocol.settings import known_revisions, layout_of
from mkdaemon.protocol.wire import WireMessage

from .talk import FlightCtrl, Reply, drive, losing

PATIENCE = Patience(attempts=4)


@given(st.lists(st.sampled_from(["ok", "request", "reply"]), max_size=80), st.integers(1, 5))
def test_backup_is_right_or_raises_and_the_live_set_stays(fates: list[str], active: int) -> None:
    board = FlightCtrl(active=active)
    live, sets = board.live, dict(board.sets)
    try:
        backup = drive(backup_settings(PATIENCE), losing(board, iter(fates)))
    except CommandRejectedError as error:
        assert error.token == "live_set_unproven"
    except RequestTimeoutError:
        assert board.live == live
    else:
        assert board.live == live
        assert (backup.active, list(backup.sets)) == (active, [1, 2, 3, 4, 5])
        assert backup.sets == {slot: raw + bytes(2) for slot, raw in sets.items()}, "padded, as the line delivers them"
    assert (board.sets, board.active) == (sets, active)


def test_a_live_set_that_changed_is_named_by_byte() -> None:
    board = FlightCtrl(active=1)

    def talk(request: WireMessage) -> Reply:
        reply = board(request)
        if isinstance(request, SettingsRequest) and request.index == 5:
            board.sets[1] = board.sets[1][:40] + b"\x01\x02" + board.sets[1][42:]
        return reply

    with pytest.raises(CommandRejectedError, match=r"live_set_changed.*byte 40, byte 41"):
        drive(backup_settings(PATIENCE), talk)


def test_a_moved_active_set_is_named() -> None:
    board = FlightCtrl(active=1)

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, SettingsRequest) and request.index == 5:
            board.active = 4
        return board(request)

    with pytest.raises(CommandRejectedError, match="reports that set 4 is active; set 1 was before"):
        drive(backup_settings(PATIENCE), talk)


def changed(raw: bytes, at: int = 10) -> bytes:
    return raw[:at] + bytes([raw[at] ^ 0x55]) + raw[at + 1 :]


def test_restore_writes_only_what_differs_and_keeps_the_active_set() -> None:
    board = FlightCtrl(active=3)
    before, wanted = dict(board.sets), {1: changed(board.sets[1]), 2: board.sets[2]}
    for sets, dry_run in ((before, False), (wanted, True)):
        assert drive(restore_settings(sets, PATIENCE, dry_run=dry_run), board).written == ()
        assert (board.sets, board.live) == (before, before[3])
    done = drive(restore_settings(wanted, PATIENCE), board)
    assert done.written == (1, 3)
    assert board.sets == before | wanted
    assert (board.active, board.live) == (3, board.sets[3])
    assert differing(wanted[1], done.stored[1]) == ()
    assert differing(wanted[1], done.before[1]) == (10,)


def test_wrong_revision_and_length_write_nothing() -> None:
    board = FlightCtrl()
    before = dict(board.sets)
    with pytest.raises(CommandRejectedError, match="has revision 95, the FlightCtrl 106"):
        drive(restore_settings({1: b"\x5f" + bytes(143)}, PATIENCE), board)
    with pytest.raises(CommandRejectedError, match="holds 140 bytes for a parameter set and the FlightCtrl sends 146"):
        drive(restore_settings({1: b"\x6a" + bytes(139)}, PATIENCE), board)
    assert board.sets == before


def test_running_motors_refuse_and_nothing_changes() -> None:
    board = FlightCtrl(active=2)
    before = dict(board.sets)
    board.motors_running = True
    with pytest.raises(CommandRejectedError, match=r"write_refused.*Stop the motors"):
        drive(restore_settings({1: changed(before[1])}, PATIENCE), board)
    assert (board.sets, board.live, board.active) == (before, before[2], 2)


def test_a_failed_restore_puts_the_active_set_back() -> None:
    board = FlightCtrl(active=2)
    before = dict(board.sets)

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, WriteSettings) and request.index == 4:
            return None
        return board(request)

    with pytest.raises(RequestTimeoutError, match="write set 4: no answer"):
        drive(restore_settings({1: changed(before[1]), 4: changed(before[4])}, PATIENCE), talk)
    assert (board.active, board.live) == (2, before[2])


@given(st.lists(st.sampled_from(["ok", "request", "reply"]), max_size=60))
def test_restore_is_right_or_raises(fates: list[str]) -> None:
    board = FlightCtrl(active=3)
    wanted = {1: changed(board.sets[1]), 3: changed(board.sets[3])}
    try:
        done = drive(restore_settings(wanted, PATIENCE), losing(board, iter(fates)))
    except MkError:
        return
    assert {slot: board.sets[slot] for slot in wanted} == wanted
    assert (board.active, board.live) == (3, wanted[3])
    assert set(done.written) == {1, 3}


def test_a_board_that_never_says_the_same_is_not_believed() -> None:
    count = iter(range(100))

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, SettingsRequest):
            return Settings(index=1, parameters=bytes((106, next(count))) + bytes(144))
        return FlightCtrl()(request)

    with pytest.raises(RequestTimeoutError, match="two answers never agreed"):
        drive(backup_settings(PATIENCE), talk)


def test_a_revision_that_is_not_the_releases_own_is_never_written() -> None:
    board = FlightCtrl()
    board.sets = {slot: b"\x5f" + raw[1:126] for slot, raw in board.sets.items()}
    before = dict(board.sets)
    with pytest.raises(CommandRejectedError, match=r"revision 95 \(128 bytes\) are not known for FlightCtrl 2\.12a"):
        drive(restore_settings({1: b"\x5f" + bytes(125)}, PATIENCE), board)
    assert board.sets == before


def stubborn_board(after: int) -> tuple[FlightCtrl, Callable[[WireMessage], Reply]]:
    """A board that loses the active set while set 4 is written, and writes nothing but rubbish, or nothing at all."""
    board, writes = FlightCtrl(active=2), list[int]()

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, WriteSettings):
            writes.append(request.index)
            if request.index == 4:
                board.active = 4
                return None
            if len(writes) > after:
                return None
            board.rule = lambda raw: changed(raw, 60)
        return board(request)

    return board, talk


def test_an_active_set_that_cannot_be_put_back_is_named() -> None:
    board, talk = stubborn_board(after=99)
    with pytest.raises(CommandRejectedError, match=r"live_set_changed.*after write set 4: no answer"):
        drive(restore_settings({4: changed(board.sets[4])}, PATIENCE), talk)
    board, talk = stubborn_board(after=0)
    with pytest.raises(CommandRejectedError, match=r"live_set_unproven.*then write set 2: no answer"):
        drive(restore_settings({4: changed(board.sets[4])}, PATIENCE), talk)


def test_a_write_that_was_damaged_is_repeated() -> None:
    """The damaged one differs from what was sent once; the FlightCtrl's own will differs every time."""
    board, rules = FlightCtrl(active=3), iter([lambda raw: changed(raw, 60), bytes, bytes])
    wanted = changed(board.sets[3])

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, WriteSettings):
            board.rule = next(rules)
        return board(request)

    done = drive(restore_settings({3: wanted}, PATIENCE), talk)
    assert differing(wanted, done.stored[3]) == ()


def test_a_board_that_stores_something_else_each_time_is_told_as_it_is() -> None:
    board, places = FlightCtrl(active=3), iter((60, 61, 62))
    wanted = changed(board.sets[3])

    def talk(request: WireMessage) -> Reply:
        if isinstance(request, WriteSettings):
            board.rule = partial(changed, at=next(places))
        return board(request)

    done = drive(restore_settings({3: wanted}, PATIENCE), talk)
    assert differing(wanted, done.stored[3]) == (62,)


@pytest.mark.parametrize("revision", known_revisions())
@settings(max_examples=5)
@given(data=st.data())
def test_every_revision_is_written_read_back_and_restored(revision: int, data: st.DataObject) -> None:
    layout = layout_of(revision)
    assert layout is not None
    board = FlightCtrl(active=2, size=layout.size, revision=revision)
    first, before = board.sets[1], dict(board.sets)
    # A set may also come padded, as the line delivers it.
    wanted = bytes([revision]) + data.draw(st.binary(min_size=layout.size - 1, max_size=layout.size - 1))
    given = data.draw(st.sampled_from([wanted, pad_set(wanted)]))
    stored = drive(write_set(1, pad_set(given), PATIENCE), board)
    assert (differing(wanted, stored), board.sets[1]) == ((), wanted)
    wire = encode_frame(1, "s", WriteSettings(index=1, parameters=pad_set(wanted)).encode())
    [heard] = [item for item in FrameDecoder().feed(wire) if isinstance(item, Frame)]
    assert WriteSettings.decode(heard.payload).parameters == pad_set(wanted)
    generation = next((g for g in FC_GENERATIONS if revision in g.revisions), None)
    if generation is None:
        return
    board.release = generation.since
    assert drive(restore_settings({1: first}, PATIENCE), board).written in ((1,), ())
    assert board.sets == before
    assert board.live == first


TWICE = Patience(2)


def edited(raw: bytes, value: int = 7) -> bytes:
    return raw[:30] + bytes((value,)) + raw[31:]


def note_of(board: FlightCtrl, **sets: bytes) -> LiveSet:
    """What a procedure would note: bytes as they are received, padding included."""
    writing = {int(slot[1:]): pad_set(raw) for slot, raw in sets.items()}
    return LiveSet("2.12a", board.active, pad_set(board.sets[board.active]), writing)


def test_the_live_set_is_announced_before_another_one_is_read_and_proven_in_the_end() -> None:
    board, steps = FlightCtrl(active=2), []
    drive(backup_settings(TWICE), board, steps)
    asked = [n for n, s in enumerate(steps) if isinstance(getattr(s, "message", None), SettingsRequest)]
    other = next(n for n in asked if steps[n].message.index not in {2, 255})
    risk = next(n for n, s in enumerate(steps) if isinstance(s, LiveSetAtRisk))
    proof = next(n for n, s in enumerate(steps) if isinstance(s, LiveSetProven))
    assert risk < other < asked[-1] < proof
    assert steps[risk].wanted == note_of(board)
    drive(backup_settings(TWICE, ()), board, alone := [])
    assert not any(isinstance(step, LiveSetAtRisk) for step in alone), "the active set puts nothing at risk"


def test_a_restore_announces_what_it_writes_before_it_writes() -> None:
    board, steps = FlightCtrl(active=2), []
    wanted = edited(board.sets[4])
    drive(restore_settings({4: wanted}, TWICE), board, steps)
    write = next(n for n, s in enumerate(steps) if isinstance(getattr(s, "message", None), WriteSettings))
    risk = [s for s in steps[:write] if isinstance(s, LiveSetAtRisk)][-1]
    assert set(risk.wanted.writing) == {2, 4}
    assert risk.wanted.writing[4] == pad_set(wanted)


def test_a_set_that_a_restore_had_activated_is_replaced_by_the_right_one() -> None:
    board = FlightCtrl(active=4)
    before = dict(board.sets)
    wanted = edited(board.sets[1])
    note = note_of(board, _1=wanted, _4=board.sets[4])
    board.sets[1] = board.live = wanted
    board.active = 1
    assert drive(recover_live_set(note, TWICE), board) is Recovered.WRITTEN
    assert (board.active, board.live) == (4, before[4])
    assert board.sets == {**before, 1: wanted}


@pytest.mark.parametrize("written", [3, 40, 72, 140, 144])
def test_an_active_set_that_was_written_in_part_or_whole_gets_its_old_bytes(written: int) -> None:
    board = FlightCtrl(active=4)
    before = board.sets[4]
    wanted = before[:2] + bytes(byte ^ 0x55 for byte in before[2:])
    note = note_of(board, _4=wanted)
    board.sets[4] = board.live = wanted[:written] + before[written:]
    assert drive(recover_live_set(note, TWICE), board) is Recovered.WRITTEN
    assert board.live == board.sets[4] == before


@pytest.mark.parametrize("case", ["release", "active set", "bytes", "old set", "nothing was written"])
def test_another_aircraft_is_recognised_and_nothing_is_written_to_it(case: str) -> None:
    board = FlightCtrl(active=4)
    note = note_of(board, _1=edited(board.sets[1]), _4=board.sets[4])
    far = board.sets[1][:60] + bytes(range(1, 21)) + board.sets[1][80:]
    match case:
        case "release":
            note = LiveSet("2.08a", 4, board.sets[4], {})
        case "active set":
            board.active, board.live = 2, board.sets[2]
        case "bytes":
            board.sets[1], board.active = far, 1
        case "old set":
            board.sets[1], board.active, board.sets[4] = edited(board.sets[1]), 1, far
        case _:
            note = note_of(board)
            board.sets[4] = far
    before, active = dict(board.sets), board.active
    steps = []
    assert drive(recover_live_set(note, TWICE), board, steps) is Recovered.OTHER_AIRCRAFT
    assert (board.sets, board.active) == (before, active)
    assert not any(isinstance(step, LiveSetProven) for step in steps)
    if case != "release":
        assert board.live == board.sets[active]


def test_a_set_that_cannot_be_changed_is_not_left_live() -> None:
    board = FlightCtrl(active=2)

    def change(raw: bytes) -> bytes:
        raise ProtocolError("no such parameter")

    with pytest.raises(ProtocolError):
        drive(edit_settings(5, change, TWICE), board)
    assert board.live == board.sets[2]


def test_an_edit_changes_one_set_and_a_dry_run_shows_it() -> None:
    board = FlightCtrl(active=2)
    before = dict(board.sets)
    shown = drive(edit_settings(5, edited, TWICE, dry_run=True), board)
    assert (board.sets, shown.written, shown.stored[5][30]) == (before, (), 7)
    done = drive(edit_settings(None, edited, TWICE), board)
    assert (done.written, board.live[30], board.active) == ((2,), 7, 2)
