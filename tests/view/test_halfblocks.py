"""A picture in letters: the brightness of every part is read back."""

from __future__ import annotations

import numpy as np

from mkdaemon.view.halfblocks import OUTLINE, RAMP, picture_rows

STEPS = np.repeat(np.repeat(np.arange(8, dtype=np.uint8)[None, :] * 30, 40, axis=0), 10, axis=1)
"""40 rows of 80 columns, eight grey values from left to right."""


def test_letters_get_brighter_with_the_picture_and_keep_its_shape():
    rows = [row.plain for row in picture_rows(STEPS, [], 40, 30, has_colours=False)]
    assert (len(rows), {len(row) for row in rows}) == (10, {40})
    expected = [RAMP[int(grey * len(RAMP) / 256)] for grey in range(0, 240, 30)]
    assert rows[0] == "".join(letter * 5 for letter in expected)
    tiny = np.array([[0, 250]], np.uint8)
    assert [row.plain for row in picture_rows(tiny, [], 8, 8, has_colours=False)] == ["    @@@@"] * 2


def test_two_pixels_a_letter_have_their_own_grey():
    halves = np.zeros((4, 4), np.uint8)
    halves[0] = 200
    halves[3] = 90
    upper, lower = picture_rows(halves, [], 4, 2, has_colours=True)
    assert upper.plain == "\u2580" * 4
    styles = [row.spans[0].style for row in (upper, lower)]
    found = [(style.color.triplet.red, style.bgcolor.triplet.red) for style in styles]
    assert found == [(200, 0), (0, 90)]


def test_an_outline_is_drawn_where_the_tag_is_and_none_outside():
    corners = np.array([[20.0, 8.0], [60.0, 8.0], [60.0, 32.0], [20.0, 32.0]])
    rows = [row.plain for row in picture_rows(STEPS, [corners, corners + 1000.0], 40, 30, has_colours=False)]
    assert rows[2][10:31] == "o" * 21
    assert [row.count("o") for row in rows] == [0, 0, 21, 2, 2, 2, 2, 2, 21, 0]
    drawn = picture_rows(STEPS, [corners], 40, 30, has_colours=True)
    assert any(span.style.color.triplet == OUTLINE for row in drawn for span in row.spans)
