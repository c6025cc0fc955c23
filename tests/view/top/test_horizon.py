"""The artificial horizon shows the attitude it was given."""

from __future__ import annotations

import math

import pytest

from mkdaemon.view.top.horizon import DEGREES_A_ROW, horizon

COLUMNS, ROWS = 31, 9


def line(drawn):
    """Row of the line in the first, middle and last column; the aircraft hides the middle's."""
    return [next((row for row, text in enumerate(drawn) if text[column] in "-/\\"), None) for column in (0, -1)]


def test_level_flight_has_the_line_in_the_middle():
    drawn = horizon(0.0, 0.0, COLUMNS, ROWS)
    assert [len(row) for row in drawn] == [COLUMNS] * ROWS
    assert drawn[4] == "-" * 13 + "==o==" + "-" * 13
    assert set("".join(drawn[:4])) == {" "}
    assert set("".join(drawn[5:])) == {":"}


@pytest.mark.parametrize("rows", [-3, -1, 1, 3])
def test_nose_down_moves_the_line_up_by_its_scale(rows):
    assert line(horizon(0.0, math.radians(rows * DEGREES_A_ROW), COLUMNS, ROWS)) == [4 - rows, 4 - rows]


def test_right_side_down_raises_the_right_end():
    left, right = line(horizon(math.radians(10.0), 0.0, COLUMNS, ROWS))
    # A row is twice as high as a letter is wide: 15 letters to the side are 7.5 rows.
    assert (left, right) == (5, 3)
    assert "/" in "".join(horizon(math.radians(40.0), 0.0, COLUMNS, ROWS))
    assert "\\" in "".join(horizon(math.radians(-40.0), 0.0, COLUMNS, ROWS))


def test_on_its_back_the_ground_is_above():
    drawn = horizon(math.pi, 0.0, COLUMNS, ROWS)
    assert set(drawn[0]) == {":"}
    assert set(drawn[-1]) == {" "}
