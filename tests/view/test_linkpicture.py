"""The picture of a measurement of the line: its figures are read back."""

from __future__ import annotations

from xml.etree import ElementTree

from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probes import Probe, ProbeKind
from mkdaemon.view.linkpicture import BINS, SLICES, link_picture

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
