"""`mkctl log report` as a command: the file it writes, and mistakes in one line."""

from __future__ import annotations

import json
from functools import partial

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.view.report import page
from mkdaemon.view.report.make import report_of
from tests.places import DATA
from tests.view.report.compared import Wrong, apart, recorded

FLIGHT = DATA / "recordings" / "fc_sticks.mcap"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page, "plotly_source", lambda: "library")
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


def test_the_terminal_has_the_tables_of_the_page(report, folder):
    path = recorded(folder / "scaled.mcap", Wrong(scale=1.02))
    code, out, err = report(path, "--against", "mocap")
    assert (code, err) == (EXIT_OK, "")
    assert out.startswith("down against mocap\n")
    assert out.endswith("scaled.html\n")
    (chapter,) = report_of(path, None, against="mocap").chapters
    for table in chapter.sheets:
        assert table.title in out
        assert all(cell in out for row in table.rows for cell in row)
    code, out, _ = report(path, "--against", "mocap", "--json", "--force")
    (found,) = json.loads(out)["against"]
    assert (code, found["camera"], found["is_answered"]) == (EXIT_OK, "down", True)
    assert found["tables"]["Rates and drop-outs"][1]["down"] == "20.0"


def test_a_recording_that_does_not_answer_says_what_to_do(report, folder):
    path = apart(folder / "apart.mcap")
    code, out, err = report(path, "--against", "mocap")
    assert (code, err) == (EXIT_FAILURE, "")
    assert "do not overlap in time: record both at once" in out
    assert '<section class="warn"><h2>down against mocap' in (folder / "apart.html").read_text(encoding="utf-8")
    code, out, err = report(path, "--against", "vicon", "--force")
    assert (code, out, len(err.splitlines())) == (EXIT_CONFIG, "", 1)
    assert "no poses by vicon; it has poses by: down, mocap" in err
