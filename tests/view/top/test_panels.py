"""Rows of the terminal view: every true value is read back, stale ones say so, strangers' texts are spelled."""

from __future__ import annotations

import copy

import pytest

from mkdaemon.view.top.panels import COLUMNS, ROWS, Board, Tone, clipped
from tools.top_picture import KNOWN

NOW = 1000.0


def board_of(changes=(), at=NOW):
    board, known = Board("quad"), copy.deepcopy(KNOWN)
    for key, name, value in changes:
        known[key][name] = value
    for suffix, fields in known.items():
        board.take(suffix, fields, at)
    return board


def shown(board, now=NOW):
    return "\n".join("".join(text for text, _ in row) for row in board.rows(now))


def test_every_value_of_a_known_state_is_shown():
    text = shown(board_of())
    for words in (
        "alive, motors RUN",
        "roll +10.0 pitch -5.0 heading 060 deg",
        "FLYING, GPS hold, 83 s in the air",
        "2.15 m above start",
        "1.2 m/s over ground, -0.4 up",
        "15.2 V (4 x 3.80), 11.5 A, 812 mAh",
        "9 satellites, position valid, usable",
        "receiver 97 %",
        "up: both directions proven",
        "round trip 52.7 ms, 99 % 94.9 ms, STALE: debug",
        "link tests   409 of 415 answered, 1 late, 5 unanswered (5 lost)",
        "requests     187 of 190 answered, 3 unanswered (2 lost, 1 withdrawn)",
        "stick frames 2840 of 2912 answered, 71 unanswered (41 lost, 30 replaced)",
        "down 30/s, 94 % posed, pad x +0.12 y -0.34 z 1.98 m",
        "FLYING, ann has the lease, takeoff climbing",
        "ann flies; the pilot holds hover",
        "FAILSAFE release: the client died",
        "WARNING heights contradict",
        "==o==",
    ):
        assert words in text, words
    assert "STALE 0" not in text


@pytest.mark.parametrize("board", [Board("quad"), board_of(), board_of([("link/state", "reason", "x" * 300)])])
def test_it_is_always_24_rows_of_at_most_80_columns(board):
    rows = board.rows(NOW)
    assert len(rows) == ROWS
    assert max(sum(len(text) for text, _ in row) for row in rows) <= COLUMNS


def test_nothing_known_says_so():
    text = shown(Board("quad"))
    for words in ("not heard yet", "no attitude yet", "battery  unknown", "link     unknown", "no camera"):
        assert words in text, words


def test_stale_values_say_how_old_they_are_each_at_its_own_time():
    board = board_of()
    board.take("link/health", KNOWN["link/health"], NOW + 2.0)
    text = shown(board, NOW + 2.0)
    assert "STALE 2 s" in text  # attitude comes twenty times a second
    assert "STALE 2 s: 15.2 V" not in text
    assert "pad NOT SEEN for 2 s" in text
    text = shown(board, NOW + 65.0)
    assert "STALE 65 s: 15.2 V" in text
    assert "NOTHING HEARD FOR 63 s" in text
    attitude = next(row for row in board.rows(NOW + 65.0) if any("roll" in text for text, _ in row))
    assert ("STALE 65 s: ", Tone.WARN) in attitude
    asked = Board("quad")
    asked.take("state/battery", {**KNOWN["state/battery"], "age": 40.0}, NOW)
    assert "STALE 40 s" in shown(asked)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("health", "is_alive", False), "NOT ALIVE"),
        (("health", "error", "no FC"), "ERROR no FC"),
        (("health", "read_only", "unknown release"), "READ ONLY"),
        (("state/battery", "is_low", True), "LOW 15.2 V"),
        (("state/battery", "voltage", 13.9), "LOW"),
        (("state/pilot", "has_signal", False), "NO SIGNAL"),
        (("state/gps", "is_usable", False), "NOT usable"),
        (("link/state", "condition", "one_way"), "ONE_WAY: "),
        (("vision/down/stats", "state", "dark"), "down DARK: "),
        (("vision/down/stats", "alarms", {"blurred": "clean the lens"}), "BLURRED"),
        (("control/status", "phase", "stale"), "STALE, ann"),
        (("state/flight", "emergency_landing", True), "EMERGENCY LANDING"),
    ],
)
def test_what_is_wrong_is_a_word_beside_its_colour(change, words):
    board = board_of([change])
    assert words in shown(board)
    parts = [part for row in board.rows(NOW) for part in row]
    loud = "".join(text for text, tone in parts if tone in (Tone.WARN, Tone.BAD))
    assert words.strip(", ").split()[0].strip(":,") in loud or words == "NOT usable"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("state/flight", "emergency_landing", True), "EMERGENCY LANDING, alive"),
        (("control/status", "trouble", "NO POSE FOR 1.2 S, releases in 1.8 s"), "NO POSE FOR 1.2 S, releases in 1.8 s"),
        (("state/battery", "is_low", True), "BATTERY LOW, alive"),
        (("link/state", "condition", "mute"), "the board is mute, alive"),
    ],
)
def test_the_first_row_begins_with_the_worst(change, words):
    board = board_of([change])
    assert shown(board).split("\n")[0].startswith(f" quad  {words}")
    assert board.rows(NOW)[0][2][1] is Tone.BAD


def test_a_chain_of_causes_that_is_longer_than_the_first_row_goes_on_below_the_phase():
    chain = (
        "NO POSE FOR 1.2 S, releases in 1.8 s: tag in view, 46 poses refused off_course; attitude silent 3.4 s; "
        "3 of 9 link tests unanswered"
    )
    board = board_of([("control/status", "trouble", chain)])
    rows = shown(board).split("\n")
    below = next(place for place, row in enumerate(rows) if row.startswith("control"))
    assert f"{rows[0].removeprefix(' quad  ').split(', alive')[0]} {rows[below + 1].strip()}" == chain
    assert "NO POSE" not in shown(board, NOW + 9.0), "a chain that is old is no chain"


def test_texts_of_strangers_act_on_nothing():
    evil = "\x1b[2J\nfake row\u202e"
    changes = [
        ("link/state", "reason", evil),
        ("health", "error", evil),
        ("control/status", "reason", evil),
        ("control/status", "stage", evil),
        ("control/status", "hands", evil),
        ("control/status", "lease", {"holder": evil}),
        ("vision/down/stats", "camera", evil),
        ("vision/down/pose", "target", evil),
        ("event/failsafe", "reason", evil),
        ("event/log", "text", evil),
    ]
    board = board_of(changes)
    board.vehicle, board.fleet, board.notice = evil, ["quad", evil + "2"], evil
    refused = {"token": "t", "key": evil, "reason": evil, "fix": evil}
    board.take("event/command", refused, NOW)
    text = shown(board)
    assert text.count("\n") == ROWS - 1
    assert not {"\x1b", "\u202e"} & set(text)
    assert "\\x1b[2J\\nfake row" in text


def test_only_events_worth_a_row_have_one():
    board = Board("quad")
    board.take("event/log", {"level": "info", "text": "chatter"}, NOW)
    board.take("event/command", {"token": None, "key": "do/rates", "reason": None}, NOW)
    refused = {"token": "lease_held", "key": "do/lease", "reason": "ann holds it.", "fix": "Ask her."}
    board.take("event/command", refused, NOW - 130.0)
    board.take("event/mode", {"before": "free", "after": "leased", "reason": "ann"}, NOW)
    text = shown(board)
    assert "chatter" not in text
    assert "do/rates" not in text
    assert "2 min ago  REFUSED do/lease: ann holds it. Ask her." in text
    assert "free -> leased: ann" in text


def test_other_vehicles_are_named_and_a_cut_row_says_so():
    board = board_of()
    board.fleet = ["quad", "hexa"]
    assert "also: hexa" in shown(board)
    assert clipped([("abcdef", Tone.PLAIN), ("", Tone.BAD), ("ghij", Tone.DIM)], 8) == [
        ("abcdef", Tone.PLAIN),
        ("g>", Tone.DIM),
    ]
