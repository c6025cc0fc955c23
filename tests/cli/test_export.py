"""`mkctl log export`: what is written, and what is refused."""

from __future__ import annotations

import csv
import json
import sys
from functools import partial
from xml.etree import ElementTree

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_OK
from tests.places import DATA

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
