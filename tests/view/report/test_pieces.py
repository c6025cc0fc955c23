"""Manoeuvres in their stages and places, with their errors."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from mkdaemon.record.summary import summarise
from mkdaemon.view.report.flight import FlightReader
from mkdaemon.view.report.pieces import Errors, pieces_of
from mkdaemon.view.report.verdict import flown_time, sentences
from tests.view.report.known import Tape, known_flight


def read(tape):
    reader = FlightReader()
    with TemporaryDirectory() as folder:
        summary = summarise(tape.write(Path(folder) / "a.mcap"), taker_of=reader.taker)
    reader.count(summary)
    return reader.flights[tape.vehicle]


def test_the_known_flight_has_its_known_errors():
    climb, place = pieces_of(read(known_flight()))
    assert (climb.name, climb.begin, climb.end, climb.reached, climb.goal) == ("takeoff: climbs", 1.0, 3.0, None, None)
    assert climb.errors == Errors(40, *map(pytest.approx, (20.0, 20.0, 50.0, 50.0)))
    assert (place.name, place.begin, place.end, place.goal) == ("position", 3.0, 9.0, (1.0, 0.0, 2.0))
    assert place.reached == pytest.approx(3.0)
    assert place.errors == Errors(60, *map(pytest.approx, (5.0, 5.0, 2.0, 2.0))), "counted from when it is there"
    assert place.level_end_cm == pytest.approx(5.0)


def test_a_manoeuvre_is_cut_where_its_goal_goes_to_another_place():
    tape = Tape()
    tape.add(0.0, "control/status", {"phase": "flying", "manoeuvre": "position", "stage": ""})
    for tick in range(100):
        at = tick / 10
        x = 0.0 if at < 4.0 else 1.0
        wobble = 0.5 if 2.0 <= at < 2.5 else 0.0  # a goal on its way, as of a hold that comes to rest
        tape.add(at, "control/error", {"goal": [x, wobble, 2.0], "error_pad": [0.0, 0.01, 0.0]})
    tape.add(10.0, "control/status", {"phase": "free", "manoeuvre": None})
    pieces = pieces_of(read(tape))
    assert [(piece.begin, piece.end, piece.goal) for piece in pieces] == [
        (0.0, 4.0, (0.0, 0.0, 2.0)),
        (4.0, 10.0, (1.0, 0.0, 2.0)),
    ]
    assert [piece.errors.count for piece in pieces] == [20, 40], "from 2 s after its beginning"


@pytest.mark.parametrize(
    "fields",
    [
        {"goal": [1.0, 2.0, 3.0]},  # no errors
        {"error_pad": [1.0, 2.0, 3.0]},  # no goals
        {"goal": "x", "error_pad": [None, 1, 2]},
        {"goal": [1e300] * 3, "error_pad": [float("nan")] * 3},
    ],
)
def test_strange_errors_are_left_out(fields):
    tape = Tape()
    tape.add(0.0, "control/status", {"phase": "flying", "manoeuvre": "hold", "stage": ""})
    tape.add(1.0, "control/error", fields)
    (piece,) = pieces_of(read(tape))
    assert (piece.name, piece.begin, piece.end, piece.errors) == ("hold", 0.0, 1.0, None)


def test_the_flight_in_words():
    flight = read(known_flight())
    assert flown_time(flight) == pytest.approx(8.0)
    said = " ".join(sentences(flight, pieces_of(flight), 1_760_001_000.0))
    for words in (
        "Recorded on 2025-10-09 09:10:00 UTC, 10.0 s",
        "Automatic flight for 8.0 s: takeoff, position.",
        "after arrival: 5.0 cm RMS, 5.0 cm at most, in position at 3.0 s",
        "A failsafe acted at 5.0 s: neutral: too old.",
        "Refused: 2 not_leased.",
    ):
        assert words in said


def test_a_recording_without_a_flight_has_no_word_of_one():
    tape = Tape()
    tape.add(0.0, "state/altitude", {"above_start": 1.0})
    flight = read(tape)
    assert pieces_of(flight) == []
    assert "an unknown time" in sentences(flight, [], 1e30)[0]
    assert "Automatic" not in " ".join(sentences(flight, [], 1e30))
