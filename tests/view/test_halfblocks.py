"""Pictures in letters and of a measurement of the line: brightness and figures are read back."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probes import Probe, ProbeKind
from mkdaemon.view.halfblocks import OUTLINE, RAMP, picture_rows
from mkdaemon.view.linkpicture import BINS, SLICES, link_picture

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


SVG = "{http://www.w3.org/2000/svg}"


def drawn(runs, title="Link test"):
    root = ElementTree.fromstring(link_picture(runs, title))
    return root, [text.text or "" for text in root.iter(f"{SVG}text")]


def test_figures_histogram_and_losses_are_those_that_were_measured():
    trips = [0.02] * 30 + [None] * 10 + [0.08] * 10
    probes = tuple(Probe(ProbeKind.ECHO, 0.1 * number, trip) for number, trip in enumerate(trips))
    root, texts = drawn([LoadRun("attic <&>\x1b", "light", 0.0, probes)])
    assert "attic <&>\\x1b, light load" in texts
    assert any(text.startswith("link tests: 50 sent, 20.00 % lost; 50 / 95 / 99 of 100 within 20.0") for text in texts)
    bars = [rect for rect in root.iter(f"{SVG}rect") if rect.get("fill-opacity") and float(rect.get("y")) > 58]
    left = [bar for bar in bars if float(bar.get("x")) < 500]
    right = [bar for bar in bars if float(bar.get("x")) > 500]
    assert len(left) == 2  # two lengths of round trip
    assert float(left[0].get("height")) == 3 * float(left[1].get("height"))
    assert {float(bar.get("height")) for bar in right} == {120.0}  # all lost, at full height
    assert len(right) == round(SLICES * 10 / 49) or len(right) == round(SLICES * 10 / 49) + 1
    assert BINS > 2


def test_two_lines_share_one_scale_and_an_unanswered_one_is_drawn():
    good = LoadRun("good", "full", 15.0, (Probe(ProbeKind.CONTROL, 0.0, 0.01), Probe(ProbeKind.ECHO, 0.1, 0.2)))
    mute = LoadRun("mute", "light", 0.0, (Probe(ProbeKind.ECHO, 0.0, None),))
    _, texts = drawn([good, mute])
    assert texts.count("200") == 2
    assert "good, full load, 15 stick frames a second" in texts
    assert "link tests: 1 sent, none answered" in texts
