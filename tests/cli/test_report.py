"""`mkctl log report` as a command: the file it writes, and mistakes in one line."""

from __future__ import annotations

import json
from functools import partial

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_OK
from mkdaemon.view.report import make
from tests.places import DATA

FLIGHT = DATA / "recordings" / "fc_sticks.mcap"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(make, "plotly_source", lambda: "library")
    return tmp_path


@pytest.fixture
def report(typed):
    return partial(typed, app, "log", "report")


def test_the_page_has_the_name_of_the_recording(report, folder):
    assert report(FLIGHT) == (EXIT_OK, "fc_sticks.html\n", "")
    assert "<h1>t</h1>" in (folder / "fc_sticks.html").read_text(encoding="utf-8")
    code, _, err = report(FLIGHT)
    assert (code, "--force" in err, len(err.splitlines())) == (EXIT_CONFIG, True, 1)
    code, out, _ = report(FLIGHT, "-o", "other.html", "--json")
    assert (code, json.loads(out)) == (
        *(EXIT_OK, {"written": "other.html", "bytes": (folder / "other.html").stat().st_size}),
    )
