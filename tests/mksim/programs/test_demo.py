"""`mkdaemon demo`: what is shown, where the picture goes, what the exit code means."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import run
from tests.mksim.programs.test_rehearsal import flight
from tests.view.report.known import write_known


@pytest.fixture
def flown(monkeypatch):
    """Let the demo fly a flight that is there already; returns what may be changed of it."""
    shown = {"record": flight()}

    async def rehearse(*, seed, wind, fps, watcher, show_on, recording, is_room):
        for moment in shown["record"].moments:
            watcher(moment, None)
        write_known(recording)
        return shown["record"]

    monkeypatch.setattr("mksim.programs.rehearsal.rehearse", rehearse)
    monkeypatch.setattr("mkdaemon.view.report.make.plotly_source", lambda: "library")
    return shown


def test_a_landing_is_a_success_with_figures_and_a_picture(flown, tmp_path, capsys):
    picture = tmp_path / "flight.svg"
    assert run(app, ["demo", "--fast", "--headless", "--picture", str(picture)]) == 0
    shown = capsys.readouterr().out
    assert "landed on the target, motors off" in shown
    assert "hold over the target, horizontal RMS (cm)" in shown
    assert max(len(line) for line in shown.splitlines() if str(tmp_path) not in line) <= 80
    assert "<h1>mk1</h1>" in picture.with_suffix(".html").read_text(encoding="utf-8")
    assert ElementTree.parse(picture).getroot().tag.endswith("svg")


def test_anything_else_is_a_failure_that_says_why(flown, tmp_path, capsys):
    flown["record"] = flight(outcome="no image of pad for 3.0 s")
    assert run(app, ["demo", "--fast", "--picture", str(tmp_path / "a.svg")]) == 1
    assert "NOT landed: no image of pad for 3.0 s" in capsys.readouterr().out
