"""Polynomials of crazyswarm: what is read, and what is said of a file that is wrong."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.errors import ConfigError
from mkdaemon.missions.pathcsv import COLUMNS, read_pieces
from mkdaemon.telemetry.path import MOST_PIECES

ROW = ["1.5", *(str(k) for k in range(1, 33))]


def read(tmp_path, *rows, head="duration,x^0"):
    path = tmp_path / "way.csv"
    path.write_text("\n".join([head, *(row if isinstance(row, str) else ",".join(row) for row in rows)]))
    return read_pieces(path)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([ROW, ROW[:-1]], "way.csv:3: 32 cells, and not 33; give duration, and 8 coefficients each of x, y, z and yaw"),
        ([["1.5", "one", *ROW[2:]]], "way.csv:2: column 2: 'one' is no number; write it as 1.5 or 2e-3"),
        ([["1.5", "nan", *ROW[2:]]], "'nan' is no number"),
        ([["1.5", "inf", *ROW[2:]]], "'inf' is no number"),
        ([], "0 pieces: give 1 to 500 lines of 33 numbers"),
        ([ROW] * (MOST_PIECES + 1), "501 pieces"),
    ],
)
def test_what_is_wrong_is_said_with_its_line_and_what_to_write(tmp_path, rows, words):
    with pytest.raises(ConfigError) as wrong:
        read(tmp_path, *rows)
    assert words in str(wrong.value).replace(", line ", ":")


@given(st.binary(max_size=300))
def test_no_bytes_raise_anything_else(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("way") / "way.csv"
    path.write_bytes(content)
    try:
        pieces = read_pieces(path)
    except ConfigError:
        return
    assert all(len(piece["x"]) == (COLUMNS - 1) // 4 for piece in pieces)
