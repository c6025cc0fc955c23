"""The tables of docs/lab/accuracy.md are those of the results."""

from __future__ import annotations

import json

import pytest

from lab.vision.main import put_into
from mkdaemon.errors import ConfigError, MkError
from tests.places import ROOT
from tools.accuracy_goals import WITH
from tools.accuracy_tables import TABLES
from tools.docs import make_page

RESULTS = ROOT / "docs/results/vision.json"


def page_of(tmp_path, text, results):
    (tmp_path / "docs" / "results").mkdir(parents=True)
    (tmp_path / "docs" / "lab").mkdir()
    (tmp_path / "docs" / "lab" / "accuracy.md").write_text(text, encoding="utf-8")
    (tmp_path / "docs" / "results" / "vision.json").write_text(json.dumps(results), encoding="utf-8")
    return make_page("docs/lab/accuracy.md", tmp_path)


def test_every_table_stands_in_the_page():
    text = (ROOT / "docs/lab/accuracy.md").read_text(encoding="utf-8")
    assert [name for name in TABLES if f"<!-- table {name} -->" not in text] == []


def test_a_figure_reaches_its_table_and_the_prose_stays(tmp_path):
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    results["decks"]["level_nested"][WITH].update(posed=432, images=1000)
    page = page_of(tmp_path, "Above.\n\n<!-- table decks -->\nold\n<!-- end -->\n\nBelow.\n", results)
    assert page.startswith("Above.\n\n<!-- table decks -->\n\n| attitude |")
    assert page.endswith("|\n\n<!-- end -->\n\nBelow.\n")
    assert "| level | 43.2 % |" in page
    assert "old" not in page


def test_a_table_without_results_or_name_is_told(tmp_path):
    text = "<!-- table decks -->\n<!-- end -->\n"
    with pytest.raises(MkError, match="table 'decks': no 'decks'"):
        page_of(tmp_path / "a", text, {})
    with pytest.raises(MkError, match="no table 'doors'"):
        page_of(tmp_path / "b", text.replace("decks", "doors"), {})


def test_results_of_one_campaign_leave_the_others(tmp_path):
    file = tmp_path / "vision.json"
    put_into(file, {"decks": {"base": 1}})
    put_into(file, {"cold": {"base": 2}})
    put_into(file, {"decks": {"base": 3}})
    kept = json.loads(file.read_text(encoding="utf-8"))
    assert (kept["decks"], kept["cold"]) == ({"base": 3}, {"base": 2})
    file.write_text("[1]", encoding="utf-8")
    with pytest.raises(ConfigError, match="--into"):
        put_into(file, {"cold": {}})


def rows_of(tmp_path, name, results):
    page = page_of(tmp_path, f"<!-- table {name} -->\n<!-- end -->\n", results)
    cells = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")]
    return {row[0]: row[1:] for row in cells}


def test_a_goal_is_missed_when_its_results_miss_it(tmp_path):
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    for row in (row[WITH] for row in results["decks"].values() if isinstance(row, dict)):
        row.update(wrong=0, images=100, posed=95, nees_mean=1.0)
    results["decks"]["level_single"][WITH].update(wrong=2, posed=80, nees_mean=0.5)
    decks = rows_of(tmp_path / "decks", "deck_goals", results)
    assert decks["wrong poses: 0"][0].startswith("2 of ")
    assert decks["wrong poses: 0"][1] == "**missed**"
    assert decks[">= 90 % posed"] == ["80-95 %", "**missed** in 1 of 14"]
    assert decks["NEES 0.7-1.5, single"] == ["0.50-1.00", "**missed** in 1 of 7"]
    assert decks["NEES 0.7-1.5, nested"] == ["1.00", "met"]
    every = rows_of(tmp_path / "head", "goals", results)["wrong poses of all campaigns: 0"]
    assert every[0].startswith("6 of ")
    assert every[1] == "**missed**"


def test_a_camera_below_its_goal_is_counted(tmp_path):
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    for camera in (row for row in results["real"].values() if isinstance(row, dict)):
        camera["eyes_without"]["to_8_m"].update(images=100, posed=90)
    results["real"]["webcam"]["eyes_without"]["to_8_m"]["posed"] = 70
    goals = rows_of(tmp_path, "camera_goals", results)
    assert goals[">= 80 % without, 4-8 m"] == ["70-90 %", "**missed** in 1 of 6"]
