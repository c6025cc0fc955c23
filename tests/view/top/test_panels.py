"""Rows of the terminal views, of a vehicle and of a fleet: true values, stale ones marked, strangers' texts spelled."""

from __future__ import annotations

import math

import pytest

from mkdaemon.reading import Reading
from mkdaemon.telemetry.event import CommandEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.link import FATES
from mkdaemon.telemetry.state import Position
from mkdaemon.view.top.fleetboard import FleetBoard
from mkdaemon.view.top.panels import (
    BELOW,
    BESIDE,
    COLUMNS,
    ROWS,
    VehicleBoard,
    horizon,
)
from tests.reading.knownflight import KNOWN
from tests.values import made

NOW = 1000.0
STAMP = KNOWN["health"].stamp


def board_of(changes=(), at=NOW):
    board, known = VehicleBoard("quad"), dict(KNOWN)
    for key, name, value in changes:
        known[key] = type(known[key]).model_validate(known[key].model_dump() | {name: value})
    for suffix, value in known.items():
        board.take(suffix, value, at)
    return board


def shown(board, now=NOW):
    return "\n".join("".join(text for text, _ in row) for row in board.rows(now))


def test_every_chosen_value_of_a_known_state_is_shown_in_the_words_of_the_reading():
    reading, text = Reading(), " ".join(shown(board_of()).split())
    for suffix, value in KNOWN.items():
        reading.take(suffix, value, NOW)
    chosen = {*BESIDE, *BELOW, *FATES, "eye-down", "sight-down"}
    found = [fact.text for fact in reading.at(NOW).facts if fact.id in chosen]
    assert len(found) == len(chosen)
    assert [words for words in found if words[:60] not in text] == []
    for words in ("quad Ann flies: takeoff, climbing", "FAILSAFE release, confirmed: the client died", "==o=="):
        assert words in text, words
    assert "STALE" not in text


@pytest.mark.parametrize("board", [VehicleBoard("quad"), board_of(), board_of([("link/state", "reason", "x" * 300)])])
def test_it_is_always_24_rows_of_at_most_80_columns(board):
    rows = board.rows(NOW)
    assert len(rows) == ROWS
    assert max(sum(len(text) for text, _ in row) for row in rows) <= COLUMNS


def test_texts_of_strangers_act_on_nothing():
    evil = "\x1b[2J\nfake row\u202e"
    changes = [
        ("link/state", "reason", evil),
        ("health", "error", evil),
        ("control/status", "reason", evil),
        ("control/status", "stage", evil),
        ("control/status", "hands", evil),
        ("control/status", "lease", {"holder": evil, "epoch": 1, "ttl": 1.0, "left": 1.0}),
        ("vision/down/stats", "camera", evil),
        ("vision/down/pose", "target", evil),
        ("event/failsafe", "reason", evil),
        ("event/log", "text", evil),
    ]
    board = board_of(changes)
    board.vehicle, board.fleet, board.notice = evil, ["quad", evil + "2"], evil
    board.take("event/command", refusal(key=evil, reason=evil, fix=evil), NOW)
    text = shown(board)
    assert text.count("\n") == ROWS - 1
    assert not {"\x1b", "\u202e"} & set(text)
    assert "\\x1b[2J\\nfake row" in text


def refusal(**change):
    fields = {"key": "do/lease", "fields": {}, "status": "denied", "token": "lease_held", "reason": "ann holds it."}
    return CommandEvent(stamp=STAMP, **(fields | {"fix": "Ask her."} | change))


def test_only_events_worth_a_row_have_one_and_a_remedy_that_does_not_fit_goes_on_below():
    board = VehicleBoard("quad")
    board.take("event/log", LogEvent(stamp=STAMP, level="info", text="chatter"), NOW)
    board.take("event/command", CommandEvent(stamp=STAMP, key="do/rates", fields={}, status="accepted"), NOW)
    board.take("event/command", refusal(), NOW - 130.0)
    board.take("event/mode", ModeEvent(stamp=STAMP, before="free", after="leased", reason="ann"), NOW)
    text = shown(board)
    assert "chatter" not in text
    assert "do/rates" not in text
    assert "2 min ago  do/lease denied: ann holds it. Ask her." in text
    assert "free -> leased: ann" in text
    board = board_of()
    board.take("event/command", refusal(reason="word " * 20, fix="Set bus.allow_open to false in the file."), NOW)
    assert "in the file." in " ".join(shown(board).split())


WIDE, HIGH = 31, 9


def line(drawn):
    """Row of the line in the first, middle and last column; the aircraft hides the middle's."""
    return [next((row for row, text in enumerate(drawn) if text[column] in "-/\\"), None) for column in (0, -1)]


def test_the_line_of_the_horizon_turns_with_the_aircraft():
    drawn = horizon(0.0, 0.0, WIDE, HIGH)
    assert [len(row) for row in drawn] == [WIDE] * HIGH
    assert drawn[4] == "-" * 13 + "==o==" + "-" * 13
    assert set("".join(drawn[:4])) == {" "}
    assert set("".join(drawn[5:])) == {":"}
    left, right = line(horizon(math.radians(10.0), 0.0, WIDE, HIGH))
    # A row is twice as high as a letter is wide: 15 letters to the side are 7.5 rows.
    assert (left, right) == (5, 3)
    assert "/" in "".join(horizon(math.radians(40.0), 0.0, WIDE, HIGH))
    assert "\\" in "".join(horizon(math.radians(-40.0), 0.0, WIDE, HIGH))
    drawn = horizon(math.pi, 0.0, WIDE, HIGH)
    assert set(drawn[0]) == {":"}
    assert set(drawn[-1]) == {" "}


WALL = 1_700_000_000.0  # 22:13:20 UTC
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


def fleet_of(*names, at=NOW):
    board = FleetBoard()
    board.look(names, at)
    for name in names:
        hear(board, name, at)
    return board


def hear(board, name, at, **changes):
    for suffix, fields in (QUIET | {suffix.replace("__", "/"): fields for suffix, fields in changes.items()}).items():
        known = KNOWN.get(suffix, POSITION)
        board.take(name, suffix, type(known).model_validate(known.model_dump() | fields), at)


def fleet_rows(board, now=NOW):
    return ["".join(text for text, _ in row) for row in board.rows(now, WALL + now - NOW)]


def row_of(board, name, now=NOW):
    return next(row for row in fleet_rows(board, now) if row.startswith(name))


def test_there_is_a_row_for_each_vehicle_in_order():
    rows = fleet_rows(fleet_of("mk2", "mk10", "mk1"))
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
    board = fleet_of("mk1")
    hear(board, "mk1", NOW, **changes)
    assert words in row_of(board, "mk1")


def test_a_vehicle_or_a_value_that_is_not_heard_is_stale_alone():
    board = fleet_of("mk1", "mk2")
    hear(board, "mk1", NOW + 4.0)
    assert row_of(board, "mk1", NOW + 4.0).endswith("On the ground")
    assert row_of(board, "mk2", NOW + 4.0).endswith("NOTHING FROM THE DAEMON: silent for 4.0 s")
    assert [board.state(name, NOW + 4.0) for name in ("mk1", "mk2", "mk3")] == ["here", "stale", "unknown"]
    board = fleet_of("mk1")
    for suffix in ("health", "control/status"):
        hear(board, "mk1", NOW)
        known = KNOWN[suffix].model_dump() | QUIET[suffix]
        board.take("mk1", suffix, type(KNOWN[suffix]).model_validate(known), NOW + 7.0)
    row = row_of(board, "mk1", NOW + 7.0)
    assert row.split()[:3] == ["mk1", "-", "-"]
    assert row.endswith("battery silent for 7.0 s")


def test_who_goes_stays_as_gone_with_what_it_did_last_and_is_stale_when_it_is_back_until_it_is_heard():
    board = fleet_of("mk1", "mk2")
    hear(board, "mk2", NOW, control__status={"phase": "flying", "manoeuvre": "hold", "stage": ""})
    board.look(["mk1"], NOW + 2.0)
    said = " ".join(" ".join(fleet_rows(board, NOW + 36.0)).split())
    assert "GONE for 34 s, since 22:13:22 UTC; last: Ann flies: hold, 15.2 V" in said
    assert fleet_rows(board, NOW + 36.0)[0] == " fleet  1 here, 1 GONE"
    hear(board, "mk2", NOW + 37.0)  # what was still under way does not bring it back
    assert board.state("mk2", NOW + 37.0) == "gone"
    board = fleet_of("mk1")
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
