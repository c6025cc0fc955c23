"""Losses are the same numbers on every screen: sent, answered, late, unanswered and why, for each kind of frame."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pytest

from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.health import render as render_health
from mkdaemon.cli.mkctl.linktest import _print as print_linktest
from mkdaemon.cli.mkctl.status import render as render_status
from mkdaemon.client.linktest.advice import judge
from mkdaemon.client.linktest.campaign import _Line
from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probes import Ledger, Probe, ProbeKind
from mkdaemon.reading import Reading
from mkdaemon.telemetry.link import FATES, Fates, LinkHealth, RoundTripStats, fates_of
from mkdaemon.view.page.picture import VehiclePicture
from mkdaemon.view.report.facts import link_rows
from mkdaemon.view.top.panels import VehicleBoard
from tests.samples import link_state, stamp
from tests.view.report.known import Tape
from tests.view.report.test_pieces import read

COUNTED = {
    "link_tests": Fates(sent=1253, answered=1240, late=2, unanswered=9, waiting=2, lost=8, outage=1),
    "requests": Fates(sent=610, answered=601, late=1, unanswered=5, silent=3, lost=4, withdrawn=1),
    "stick_frames": Fates(sent=1640, answered=1622, late=3, unanswered=15, lost=12, replaced=3),
}
HEALTH = LinkHealth(
    stamp=stamp(1000.0),
    state=link_state(1000.0),
    echo=RoundTripStats(sent=50, p50_ms=20.0, p95_ms=30.0, p99_ms=44.0),
    confirm=RoundTripStats(),
    **COUNTED,
)
NAMES = {"need no answer": "silent"}


def in_status():
    reading = Reading()
    reading.take("link/health", HEALTH, 1000.0)
    return drawn(render_status("mk1", reading.at(1000.0)))


def in_top():
    board = VehicleBoard("mk1")
    board.take("link/state", link_state(1000.0), 1000.0)
    board.take("link/health", HEALTH, 1000.0)
    shown = "\n".join("".join(text for text, _ in row) for row in board.rows(1000.0))
    return re.sub(r"\n {12,}(?=\S)", " ", shown)  # what 80 columns have no room for goes on in the next row


def in_page():
    picture = VehiclePicture("mk1")
    picture.take("link/health", HEALTH, 1000.0)
    return "\n".join(f"{line['name']} {line['text']}" for line in picture.show(1000.0)["lines"])


def in_the_table_of_a_report():
    return "\n".join(" ".join(row) for row in link_rows(recorded()))


def run_of_linktest():
    """A load that begins when one frame of each kind has been answered, and ends after those of `COUNTED`."""
    line, one = _Line(), Fates(sent=1, answered=1)
    total = {
        name: fates.model_copy(update={"sent": fates.sent + 1, "answered": fates.answered + 1})
        for name, fates in COUNTED.items()
    }
    for update in (dict.fromkeys(FATES, one), COUNTED, total):
        line.take(SimpleNamespace(suffix="link/health", value=HEALTH.model_copy(update=update)), Ledger())
    return LoadRun("here", "light", 0.0, (Probe(ProbeKind.ECHO, 0.0, 0.02),), counted=line.counted)


def recorded():
    return read(Tape((0.0, "link/state", {"condition": "up"}), (1.0, "link/health", HEALTH)))


def drawn(table):
    console = Console(width=200)
    with console.capture() as captured:
        console.print(table)
    return captured.get()


def counts_of(words):
    """The counts of one line, by name."""
    answered, sent = re.search(r"(\d+) of (\d+) answered", words).groups()
    rest = re.findall(r"(\d+) (late|unanswered|waiting|need no answer|lost|replaced|outage|withdrawn)", words)
    return {"sent": int(sent), "answered": int(answered)} | {NAMES.get(name, name): int(count) for count, name in rest}


@pytest.mark.parametrize("screen", [in_status, in_top, in_page, in_the_table_of_a_report])
def test_every_screen_shows_every_count(screen):
    lines = screen().split("\n")
    for name, title in FATES.items():
        line = next(line for line in lines if line.strip().startswith(title) and "answered" in line)
        expected = {count: number for count, number in COUNTED[name] if number}
        assert counts_of(line) == expected, screen.__name__


def test_health_shows_them_as_columns():
    text = drawn(render_health(HEALTH.model_dump()))
    for name, title in FATES.items():
        line = next(line for line in text.split("\n") if title in line and "1" in line and line.count("│") > 9)
        assert [int(cell) for cell in re.findall(r"\d+", line)] == [number for _, number in COUNTED[name]]


def test_linktest_counts_what_was_sent_meanwhile(capsys):
    run = run_of_linktest()
    for name, title in FATES.items():
        assert run.counted[title] == COUNTED[name]
    print_linktest([run], [], judge([run]))
    said = capsys.readouterr().out
    assert f"link tests: {COUNTED['link_tests'].words}" in " ".join(said.split())


@pytest.mark.parametrize("strange", [{}, {"requests": None}, {"requests": {"sent": "x", "new": 3}}, {"requests": [1]}])
def test_an_older_daemon_or_a_damaged_recording_has_no_counts(strange):
    assert fates_of(strange) == {}
