"""`mkctl log` on recordings that are whole, damaged or not there: looked at, exported, reported."""

from __future__ import annotations

import csv
import json
import sys
from functools import partial
from xml.etree import ElementTree

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.record.reader import Recording
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


def test_repair_writes_beside_the_old_one_and_never_over_another(log, damaged):
    code, out, _ = log("repair", damaged)
    assert code == EXIT_OK
    target = damaged.with_name("damaged-recovered.mcap")
    assert f"{target}: " in out
    assert "are missing by their numbers" in out
    assert len(list(Recording(target).entries())) >= 160
    code, _, err = log("repair", damaged)
    assert (code, "--force" in err) == (EXIT_CONFIG, True)
    code, out, _ = log("repair", damaged, "--force", "--viewer", "--json")
    assert json.loads(out)["file"] == str(target)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--from", "1", "--to", "-0.5"], 50),
        (["--key", "state/0"], 100),
        (["--key", "mk/mk1/state/1", "-k", "state/0", "--from", "-1"], 102),
        (["--from", "2025-10-09T08:53:21.6Z"], 201),
    ],
)
def test_cut_takes_what_was_asked_for(log, whole, tmp_path, words, expected):
    code, out, err = log("cut", whole, "-o", tmp_path / "part.mcap", *words)
    assert (code, err) == (EXIT_OK, "")
    assert f"{expected} entries" in out
    assert list(Recording(tmp_path / "part.mcap").entries())


def test_merge_joins(log, whole, tmp_path):
    other = written(tmp_path / "other.mcap", [entry._replace(key="mk/mk2/state/x") for entry in ENTRIES[:5]])
    assert log("merge", whole, other, "-o", tmp_path / "all.mcap")[0] == EXIT_CONFIG, "both say they are the same part"
    code, out, _ = log("merge", other, "-o", tmp_path / "all.mcap")
    assert (code, "5 entries" in out) == (EXIT_OK, True)


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


def test_tables_are_in_a_folder_beside_where_it_is_called(export, tmp_path):
    code, out, _ = export(FLIGHT, "-k", "state/*")
    assert code == EXIT_OK
    paths = [tmp_path / line for line in out.splitlines()]
    assert {path.parent.name for path in paths} == {"nc_lost_client-csv"}
    assert all(path.name.startswith("t.state_") for path in paths)
    with paths[0].open(encoding="utf-8", newline="") as file:
        assert next(csv.reader(file))[0] == "time [s]"
    assert export(FLIGHT, "-k", "state/*")[0] == EXIT_CONFIG
    assert export(FLIGHT, "-k", "state/*", "--force")[0] == EXIT_OK


@pytest.mark.parametrize(("form", "name"), [("gpx", "nc_lost_client.gpx"), ("kml", "nc_lost_client.kml")])
def test_a_track_is_a_file(export, tmp_path, form, name):
    code, out, _ = export(FLIGHT, "-f", form, "--json")
    assert (code, json.loads(out)) == (EXIT_OK, {"written": name})
    assert ElementTree.parse(tmp_path / name).getroot().tag.endswith(form)
    code, _, err = export(FLIGHT, "-f", form)
    assert code == EXIT_CONFIG
    assert "--force" in err


def test_a_bag_is_a_folder(export, tmp_path):
    assert export(FLIGHT, "-f", "ros", "-o", "bag", "-k", "state/battery")[:2] == (EXIT_OK, "bag\n")
    assert sorted(path.name for path in (tmp_path / "bag").iterdir()) == ["bag.mcap", "metadata.yaml"]


def test_a_file_for_viewers(export, tmp_path):
    assert export(FLIGHT, "-f", "foxglove", "-k", "state/*")[:2] == (EXIT_OK, "nc_lost_client-foxglove.mcap\n")
    assert (tmp_path / "nc_lost_client-foxglove.mcap").stat().st_size > 1000


@pytest.mark.parametrize(
    ("program", "words"), [(app, ("log", "export", FLIGHT, "-f", "foxglove")), (mkdaemon, ("gateway", "foxglove"))]
)
def test_viewers_need_their_sdk(typed, tmp_path, monkeypatch, program, words):
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name.startswith(("foxglove", "mkdaemon.gateways.foxglove"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    code, _, err = typed(program, *words)
    assert code == EXIT_CONFIG
    assert "needs foxglove-sdk: pip install 'mkdaemon[foxglove]'" in err


STICKS = DATA / "recordings" / "fc_sticks.mcap"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page, "plotly_source", lambda: "library")
    return tmp_path


@pytest.fixture
def report(typed):
    return partial(typed, app, "log", "report")


def test_the_page_has_the_name_of_the_recording(report, folder):
    assert report(STICKS) == (EXIT_OK, "fc_sticks.html\n", "")
    assert "<h1>t</h1>" in (folder / "fc_sticks.html").read_text(encoding="utf-8")
    code, _, err = report(STICKS)
    assert (code, "--force" in err, len(err.splitlines())) == (EXIT_CONFIG, True, 1)
    code, out, _ = report(STICKS, "-o", "other.html", "--json")
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
