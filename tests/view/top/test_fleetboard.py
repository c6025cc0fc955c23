"""Rows of the fleet view: every vehicle with what is known of it; stale and gone ones say so, with how long."""

from __future__ import annotations

import copy

import pytest

from mkdaemon.view.top.fleetboard import FleetBoard
from mkdaemon.view.top.panels import COLUMNS, Tone
from tools.top_picture import KNOWN

NOW, WALL = 1000.0, 1_700_000_000.0  # 22:13:20 UTC
HEALTH = {**KNOWN["health"], "link": "up", "reason": "fine", "motors_running": False}
FREE = {"phase": "free", "lease": None, "pose_age": None}
POSITION = {"altitude_above_start": 12.4, "home_distance": 80.2}


def board_of(*names, at=NOW):
    board = FleetBoard()
    board.look(names, at)
    for name in names:
        hear(board, name, at)
    return board


def hear(board, name, at, **changes):
    known = {"health": HEALTH, "control/status": FREE, "state/battery": KNOWN["state/battery"]}
    known = copy.deepcopy(known) | {suffix.replace("__", "/"): fields for suffix, fields in changes.items()}
    for suffix, fields in known.items():
        board.take(name, suffix, fields, at)


def shown(board, now=NOW):
    return ["".join(text for text, _ in row) for row in board.rows(now, WALL + now - NOW)]


def row_of(board, name, now=NOW):
    return next(row for row in shown(board, now) if row.startswith(name))


def test_there_is_a_row_for_each_vehicle_in_order():
    rows = shown(board_of("mk2", "mk10", "mk1"))
    assert rows[0].startswith(" fleet  3 here")
    assert [row.split()[0] for row in rows[2:5]] == ["mk1", "mk10", "mk2"]
    assert rows[2].split() == ["mk1", "free", "up", "15.2V", "3.80", "-", "0", "s"]
    assert rows[-1].strip() == "q quit"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"control__status": {"phase": "flying", "lease": {"holder": "ann"}, "manoeuvre": "hold"}}, "FLYING hold ann"),
        ({"control__status": {**FREE, "phase": "leased", "lease": {"holder": "\x1b[2J"}}}, r"leased \x1b[2J"),
        ({"control__status": {**FREE, "pose_age": 0.4}, "state__position": POSITION}, "target 0.4 s"),
        ({"control__status": {**FREE, "pose_age": 60.0}, "state__position": POSITION}, "12m up 80m off"),
        ({"state__position": {"altitude_above_start": None, "home_distance": None}}, "GPS"),
        ({"health": {**HEALTH, "motors_running": True}}, "free motors RUN"),
        ({"health": {**HEALTH, "is_alive": False, "reason": "no board"}}, "NOT ALIVE: no board"),
        ({"health": {**HEALTH, "error": "lost compass"}}, "ERROR lost compass"),
        ({"health": {**HEALTH, "link": "one_way"}}, "ONE_WAY"),
        ({"state__battery": {**KNOWN["state/battery"], "voltage": 13.0}}, "LOW 13.0V"),
    ],
)
def test_a_row_says_who_flies_link_battery_and_place(changes, words):
    board = board_of("mk1")
    hear(board, "mk1", NOW, **changes)
    assert words in row_of(board, "mk1")


def test_a_vehicle_that_is_not_heard_is_stale_and_the_others_are_not():
    board = board_of("mk1", "mk2")
    hear(board, "mk1", NOW + 4.0)
    assert row_of(board, "mk1", NOW + 4.0).endswith("0 s")
    assert row_of(board, "mk2", NOW + 4.0).endswith("STALE 4 s")
    assert [board.state(name, NOW + 4.0) for name in ("mk1", "mk2", "mk3")] == ["here", "stale", "unknown"]


def test_one_value_that_does_not_come_is_stale_alone():
    board = board_of("mk1")
    board.take("mk1", "health", HEALTH, NOW + 7.0)
    row = row_of(board, "mk1", NOW + 7.0)
    assert "STALE 7 s" in row
    assert row.endswith("0 s")


def test_who_goes_stays_as_gone_with_since_when_and_what_it_did_last():
    board = board_of("mk1", "mk2")
    hear(board, "mk2", NOW, control__status={"phase": "flying", "lease": {"holder": "ann"}})
    board.look(["mk1"], NOW + 2.0)
    row = row_of(board, "mk2", NOW + 36.0)
    assert "GONE for 34 s, since 22:13:22 UTC; last: FLYING ann" in row
    assert shown(board, NOW + 36.0)[0] == " fleet  1 here, 1 GONE"
    hear(board, "mk2", NOW + 37.0)  # what was still under way does not bring it back
    assert board.state("mk2", NOW + 37.0) == "gone"


def test_who_comes_back_is_stale_until_it_is_heard():
    board = board_of("mk1")
    board.look([], NOW + 2.0)
    board.look(["mk1"], NOW + 20.0)
    assert board.state("mk1", NOW + 20.0) == "stale"
    hear(board, "mk1", NOW + 20.5)
    assert board.state("mk1", NOW + 20.5) == "here"


def test_who_has_just_come_is_not_heard_yet():
    board = FleetBoard()
    board.look(["mk1"], NOW)
    assert "not heard yet" in row_of(board, "mk1")
    assert board.state("mk1", NOW) == "silent"


def test_rows_are_at_most_80_columns_whatever_the_names():
    board = board_of("v" * 32)
    hear(board, "v" * 32, NOW, control__status={"phase": "flying", "lease": {"holder": "h" * 90}})
    board.notice = "x" * 200
    assert max(len(row) for row in shown(board)) <= COLUMNS
    assert (" GONE" not in shown(board)[0]) and Tone.BAR in {tone for _, tone in board.rows(NOW, WALL)[0]}
