"""`mkctl log` on recordings that are whole, damaged or not there: looked at, exported, reported."""

from __future__ import annotations

import json
from functools import partial
from xml.etree import ElementTree

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.view.report import page
from mkdaemon.view.report.make import report_of
from tests.places import DATA
from tests.record.support import sample
from tests.record.test_tools import ENTRIES, written
from tests.view.report.compared import Wrong, apart, recorded


@pytest.fixture
def log(typed):
    return partial(typed, app, "log")


@pytest.fixture
def whole(tmp_path):
    return written(tmp_path / "whole.mcap", [*ENTRIES, sample(1, "mk/mk1/event/mark")])


@pytest.fixture
def damaged(tmp_path, whole):
    path = tmp_path / "damaged.mcap"
    content = bytearray(whole.read_bytes())
    content[content.index(b"zstd", len(content) // 3) + 40] ^= 1  # inside a chunk
    path.write_bytes(content[:-100])
    return path


def test_info_shows_keys_and_marks(log, whole):
    code, out, _ = log("info", whole)
    assert code == EXIT_OK
    assert "blackbox mk1-20261122T080000Z, part 0" in out
    assert "mk/mk1/state/0" in out
    assert "mark" in out
    code, out, _ = log("info", whole, "--json")
    fields = json.loads(out)
    assert fields["entries"] == 201
    assert fields["whole"] is True
    assert {key["key"] for key in fields["keys"]} == {"mk/mk1/state/0", "mk/mk1/state/1", "mk/mk1/event/mark"}
    assert len(fields["marks"]) == 1


def test_verify_shows_whether_a_recording_is_whole(log, whole, damaged):
    assert log("verify", whole)[0] == EXIT_OK
    code, out, _ = log("verify", whole, damaged)
    assert code == EXIT_FAILURE
    assert "whole.mcap: whole, 201 entries" in out
    assert "damaged.mcap: not whole" in out
    assert "mkctl log repair" in out
    assert "missing by their numbers" in out
    code, out, _ = log("verify", damaged, "--json")
    assert json.loads(out)["damages"]


def test_list_shows_what_there_is(log, whole, damaged, tmp_path, monkeypatch):
    code, out, _ = log("list", tmp_path)
    assert code == EXIT_OK
    assert "whole.mcap" in out
    assert "not finished" in out
    code, out, _ = log("list", tmp_path, "--json")
    assert [json.loads(line)["finished"] for line in out.splitlines()] == [False, True]
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))
    assert "no recordings in" in log("list")[1]
    folder = tmp_path / "home" / "mkdaemon" / "mk1" / "recordings"
    folder.mkdir(parents=True)
    written(folder / "mine.mcap")
    assert "mine.mcap" in log("list")[1]


FLIGHT = DATA / "recordings" / "nc_lost_client.mcap"


@pytest.fixture
def export(typed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return partial(typed, app, "log", "export")


@pytest.mark.parametrize(("form", "name"), [("gpx", "nc_lost_client.gpx"), ("kml", "nc_lost_client.kml")])
def test_a_track_is_a_file(export, tmp_path, form, name):
    code, out, _ = export(FLIGHT, "-f", form, "--json")
    assert (code, json.loads(out)) == (EXIT_OK, {"written": name})
    assert ElementTree.parse(tmp_path / name).getroot().tag.endswith(form)
    code, _, err = export(FLIGHT, "-f", form)
    assert code == EXIT_CONFIG
    assert "--force" in err


STICKS = DATA / "recordings" / "fc_sticks.mcap"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page, "plotly_source", lambda: "library")
    return tmp_path


@pytest.fixture
def report(typed):
    return partial(typed, app, "log", "report")


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


def test_a_recording_that_does_not_answer_says_what_to_do(report, folder):
    path = apart(folder / "apart.mcap")
    code, out, err = report(path, "--against", "mocap")
    assert (code, err) == (EXIT_FAILURE, "")
    assert "do not overlap in time: record both at once" in out
    assert '<section class="warn"><h2>down against mocap' in (folder / "apart.html").read_text(encoding="utf-8")
    code, out, _ = report(path, "--against", "mocap", "--json", "--force")
    (found,) = json.loads(out)["against"]
    assert (code, found["camera"], found["is_answered"]) == (EXIT_FAILURE, "down", False)
    code, out, err = report(path, "--against", "vicon", "--force")
    assert (code, out, len(err.splitlines())) == (EXIT_CONFIG, "", 1)
    assert "no poses by vicon; it has poses by: down, mocap" in err
