"""Rows of the fleet view: every vehicle with what is known of it; stale and gone ones say so, with how long."""

from __future__ import annotations

import pytest

from mkdaemon.telemetry.state import Position
from mkdaemon.view.top.fleetboard import FleetBoard
from mkdaemon.view.top.panels import COLUMNS, RowStyle
from tests.values import made
from tools.top_picture import KNOWN

NOW, WALL = 1000.0, 1_700_000_000.0  # 22:13:20 UTC
LEASE = KNOWN["control/status"].lease.model_dump()
FREE = {"phase": "free", "lease": None, "pose_age": None, "manoeuvre": None, "stage": ""}
POSITION = made(Position, KNOWN["health"].stamp, altitude_above_start=12.4, home_distance=80.2)
QUIET = {
    "health": {"motors_running": False},
    "control/status": FREE,
    "state/battery": {},
    "link/state": {},
}
"""What an aircraft that waits on the ground publishes: changes of a known flight."""


def board_of(*names, at=NOW):
    board = FleetBoard()
    board.look(names, at)
    for name in names:
        hear(board, name, at)
    return board


def hear(board, name, at, **changes):
    for suffix, fields in (QUIET | {suffix.replace("__", "/"): fields for suffix, fields in changes.items()}).items():
        known = KNOWN.get(suffix, POSITION)
        board.take(name, suffix, type(known).model_validate(known.model_dump() | fields), at)


def shown(board, now=NOW):
    return ["".join(text for text, _ in row) for row in board.rows(now, WALL + now - NOW)]


def row_of(board, name, now=NOW):
    return next(row for row in shown(board, now) if row.startswith(name))


def test_there_is_a_row_for_each_vehicle_in_order():
    rows = shown(board_of("mk2", "mk10", "mk1"))
    assert rows[0].startswith(" fleet  3 here")
    assert [row.split()[0] for row in rows[2:5]] == ["mk1", "mk10", "mk2"]
    assert rows[2].split() == ["mk1", "15.2", "V", "-", "On", "the", "ground"]
    assert rows[-1].strip() == "q quit"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"control__status": {"phase": "flying", "manoeuvre": "hold", "stage": ""}}, "Ann flies: hold"),
        (
            {"control__status": FREE | {"phase": "leased", "lease": LEASE | {"holder": "\x1b[2J"}}},
            r"\x1b[2J waits to fly",
        ),
        ({"control__status": {**FREE, "pose_age": 0.4}, "state__position": {}}, "pose 0.4 s"),
        ({"control__status": {**FREE, "pose_age": 60.0}, "state__position": {}}, "80 m off"),
    ],
)
def test_a_row_says_the_worst_battery_and_place(changes, words):
    board = board_of("mk1")
    hear(board, "mk1", NOW, **changes)
    assert words in row_of(board, "mk1")


def test_a_vehicle_or_a_value_that_is_not_heard_is_stale_alone():
    board = board_of("mk1", "mk2")
    hear(board, "mk1", NOW + 4.0)
    assert row_of(board, "mk1", NOW + 4.0).endswith("On the ground")
    assert row_of(board, "mk2", NOW + 4.0).endswith("NOTHING FROM THE DAEMON: silent for 4.0 s")
    assert [board.state(name, NOW + 4.0) for name in ("mk1", "mk2", "mk3")] == ["here", "stale", "unknown"]
    board = board_of("mk1")
    for suffix in ("health", "control/status"):
        hear(board, "mk1", NOW)
        known = KNOWN[suffix].model_dump() | QUIET[suffix]
        board.take("mk1", suffix, type(KNOWN[suffix]).model_validate(known), NOW + 7.0)
    row = row_of(board, "mk1", NOW + 7.0)
    assert row.split()[:3] == ["mk1", "-", "-"]
    assert row.endswith("battery silent for 7.0 s")


def test_who_goes_stays_as_gone_with_what_it_did_last_and_is_stale_when_it_is_back_until_it_is_heard():
    board = board_of("mk1", "mk2")
    hear(board, "mk2", NOW, control__status={"phase": "flying", "manoeuvre": "hold", "stage": ""})
    board.look(["mk1"], NOW + 2.0)
    said = " ".join(" ".join(shown(board, NOW + 36.0)).split())
    assert "GONE for 34 s, since 22:13:22 UTC; last: Ann flies: hold, 15.2 V" in said
    assert shown(board, NOW + 36.0)[0] == " fleet  1 here, 1 GONE"
    hear(board, "mk2", NOW + 37.0)  # what was still under way does not bring it back
    assert board.state("mk2", NOW + 37.0) == "gone"
    board = board_of("mk1")
    board.look([], NOW + 2.0)
    board.look(["mk1"], NOW + 20.0)
    assert board.state("mk1", NOW + 20.0) == "stale"
    hear(board, "mk1", NOW + 20.5)
    assert board.state("mk1", NOW + 20.5) == "here"


def test_who_has_just_come_is_not_heard_yet():
    board = FleetBoard()
    board.look(["mk1"], NOW)
    assert "no value has arrived yet" in row_of(board, "mk1")
    assert board.state("mk1", NOW) == "silent"


def test_rows_are_at_most_80_columns_whatever_the_names():
    board = board_of("v" * 32)
    hear(board, "v" * 32, NOW, control__status={"phase": "leased", "lease": LEASE | {"holder": "h" * 90}})
    board.notice = "x" * 200
    assert max(len(row) for row in shown(board)) <= COLUMNS
    assert (" GONE" not in shown(board)[0]) and RowStyle.BAR in {tone for _, tone in board.rows(NOW, WALL)[0]}
