"""Blind flight is the same gap in all plots, and figures of errors leave it out and say so."""

from __future__ import annotations

import pytest

from mkdaemon.view.report.pieces import pieces_of
from mkdaemon.view.report.plots import plots_of
from mkdaemon.view.report.verdict import sentences
from tests.samples import estimate
from tests.view.report.known import error_at, known_flight
from tests.view.report.test_pieces import read

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


def test_there_is_one_gap(flight):
    ((begin, end),) = flight.gaps
    assert (begin, end) == (pytest.approx(BEGIN, abs=0.06), pytest.approx(END, abs=0.06))


def test_every_plot_over_time_has_the_same_band(flight):
    ((begin, end),) = flight.gaps
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
