"""Manoeuvres with their errors, the head of a report with its chain of causes, gaps of blind flight, thinned lines."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from mkdaemon.record.summary import summarise
from mkdaemon.view.report.flight import FlightReader
from mkdaemon.view.report.happenings import MOST_TROUBLES, Trouble, take_causes
from mkdaemon.view.report.pieces import Errors, pieces_of
from mkdaemon.view.report.plots import plots_of
from mkdaemon.view.report.timeseries import thin
from mkdaemon.view.report.verdict import flown_time, head_of, sentences
from tests.samples import estimate
from tests.view.report.known import Tape, error_at, known_flight


def read(tape):
    reader = FlightReader()
    with TemporaryDirectory() as folder:
        summary = summarise(tape.write(Path(folder) / "a.mcap"), taker_of=reader.taker)
    reader.count(summary)
    return reader.flights[tape.vehicle]


def test_the_known_flight_has_its_known_errors_and_words():
    flight = read(known_flight())
    climb, place = pieces_of(flight)
    assert (climb.name, climb.begin, climb.end, climb.reached, climb.goal) == ("takeoff: climbs", 1.0, 3.0, None, None)
    assert climb.errors == Errors(40, *map(pytest.approx, (20.0, 20.0, 50.0, 50.0)))
    assert (place.name, place.begin, place.end, place.goal) == ("position", 3.0, 9.0, (1.0, 0.0, 2.0))
    assert place.reached == pytest.approx(3.0)
    assert place.errors == Errors(60, *map(pytest.approx, (5.0, 5.0, 2.0, 2.0))), "counted from when it is there"
    assert place.level_end_cm == pytest.approx(5.0)
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


BEGIN, END = 6.5, 7.8
"""No image is used meanwhile [s]."""


@pytest.fixture(scope="module")
def flight():
    """The known flight with a gap, in which the error would be 9 m."""
    tape = known_flight()
    tape.entries = [one for one in tape.entries if one.suffix not in ("control/estimate", "control/error")]
    for tick in range(160):
        at = 1.0 + tick / 20
        is_blind = BEGIN < at < END
        error = (9.0, 0.0, 0.0) if is_blind and at - BEGIN > 0.5 else error_at(at)
        position = tuple(goal + part for goal, part in zip((1.0, 0.0, 2.0), error, strict=True))
        blind = estimate(at, position=position, image_age=at - BEGIN if is_blind else 0.05)
        tape.add(at, "control/estimate", blind)
        tape.add(at, "control/error", {"goal": (1.0, 0.0, 2.0), "error_pad": error, "manoeuvre": "position"})
    return read(tape)


def test_there_is_one_gap_and_every_plot_over_time_has_its_band(flight):
    ((begin, end),) = flight.gaps
    assert (begin, end) == (pytest.approx(BEGIN, abs=0.06), pytest.approx(END, abs=0.06))
    plots = [plot for plot in plots_of(flight, pieces_of(flight)) if not plot.times]
    assert len(plots) > 4
    for plot in plots:
        bands = [shape for shape in plot.layout["shapes"] if "192,57,43" in shape["fillcolor"]]
        assert [(band["x0"], band["x1"]) for band in bands] == [(round(begin, 3), round(end, 3))]


def test_errors_leave_it_out_and_say_so(flight):
    pieces = pieces_of(flight)
    assert max(piece.errors.level_max_cm for piece in pieces if piece.errors and not piece.stage) == pytest.approx(5.0)
    assert [piece.blind for piece in pieces] == [0.0, pytest.approx(END - BEGIN, abs=0.12)]
    assert "s of blind flight are left out" in " ".join(sentences(flight, pieces, 0.0))
    error = next(plot for plot in plots_of(flight, pieces) if plot.name == "error")
    for trace in error.data:
        inside = [y for x, y in zip(trace["x"], trace["y"], strict=True) if BEGIN + 0.1 < x < END - 0.1]
        assert inside and set(inside) == {None}


POSE = {"kind": "no_pose", "text": "no pose for 1.0 s", "seconds": 1.0}


def causes(pose_age, refused=0):
    """The causes of a moment, as the flight core publishes them."""
    found = [{"kind": "no_pose", "text": f"no pose for {pose_age:.1f} s", "seconds": pose_age}]
    if refused:
        found.append({"kind": "refused", "text": f"{refused} poses refused off_course", "count": refused})
    found.append({"kind": "no_attitude", "text": f"attitude silent {pose_age + 0.4:.1f} s", "seconds": pose_age + 0.4})
    return found


def flight_of(*, released):
    """A hold: a trouble of 1.2 s that it outlives, and one that ends it at 44.8 s."""
    flown = {"phase": "flying", "manoeuvre": "hold", "reason": "ann flies"}
    tape = Tape((0.0, "state/altitude", {"above_start": 0.0}), (10.0, "control/status", flown))
    for tick in range(4):
        tape.add(20.0 + 0.2 * tick, "control/status", flown | {"causes": causes(0.6 + 0.2 * tick)})
    tape.add(20.8, "control/status", flown | {"causes": []})
    for tick in range(13 * released):
        reported = causes(0.6 + 0.2 * tick, refused=3 * tick)
        tape.add(42.4 + 0.2 * tick, "control/status", flown | {"causes": reported})
    end = {"phase": "releasing", "reason": "no image of pad for 3.0 s", "outcome": None}
    tape.add(44.8, "control/status", end if released else {**end, "reason": "landed on pad", "outcome": "landed"})
    if released:
        tape.add(45.0, "event/failsafe", {"action": "release", "reason": "no image", "released": True})
    tape.add(46.0, "control/status", {"phase": "free", "reason": "no image of pad for 3.0 s"})
    return read(tape)


def test_a_release_begins_with_its_chain_the_effect_first_each_with_its_time():
    head = head_of(flight_of(released=True))
    assert (head.text, head.is_bad) == ("FAILED at 44.8 s: no image of pad for 3.0 s.", True)
    times, texts = zip(*head.chain, strict=True)
    assert texts == (
        "no pose for 3.0 s",
        "36 poses refused off_course",
        "attitude silent 3.4 s",
        "survived: no pose for 1.2 s; attitude silent 1.6 s; ended at 20.8 s",
    )
    assert times == pytest.approx((41.8, 42.6, 41.4, 19.0), abs=0.01)


def test_a_flight_that_lands_says_so_with_the_trouble_that_it_outlived():
    head = head_of(flight_of(released=False))
    assert (head.text, head.is_bad) == ("Ended at 44.8 s: landed on pad (landed).", False)
    assert [text for _, text in head.chain] == ["survived: no pose for 1.2 s; attitude silent 1.6 s; ended at 20.8 s"]


def test_a_recording_of_many_troubles_keeps_the_first():
    troubles: list[Trouble] = []
    for tick in range(2 * MOST_TROUBLES + 4):
        take_causes(troubles, float(tick), {"causes": [POSE] if tick % 2 else []})
    assert len(troubles) == MOST_TROUBLES


@pytest.mark.parametrize("count", [0, 1, 5, 100, 101, 5000])
def test_a_thinned_line_keeps_its_ends_and_extremes(count):
    times = np.arange(count, dtype=float)
    values = np.sin(times / 30.0)
    if count == 5000:
        values[1234], values[4321] = 9.0, -9.0
    found_times, found = thin(times, values, 100)
    assert len(found) <= 102
    assert np.all(np.diff(found_times) > 0)
    assert set(zip(found_times, found, strict=True)) <= set(zip(times, values, strict=True))
    if count:
        assert (found_times[0], found_times[-1]) == (0.0, count - 1.0)
        assert (found.min(), found.max()) == (values.min(), values.max())
