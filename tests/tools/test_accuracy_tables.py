"""The tables of docs/lab/accuracy.md are those of the results."""

from __future__ import annotations

import json

import pytest

from lab.vision.main import put_into
from mkdaemon.errors import ConfigError, MkError
from tests.places import ROOT
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
    results["decks"]["level_nested"]["eyes_with_attitude"].update(posed=432, images=1000)
    page = page_of(tmp_path, "Above.\n\n<!-- table decks -->\nold\n<!-- end -->\n\nBelow.\n", results)
    assert page.startswith("Above.\n\n<!-- table decks -->\n\n| attitude, target |")
    assert page.endswith("|\n\n<!-- end -->\n\nBelow.\n")
    assert "| level nested | 43.2 %, 0;" in page
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


def test_wrong_poses_are_counted_in_every_campaign(tmp_path):
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    before = rows_of(tmp_path / "before", "wrong", results)
    assert before["all"][-1] == str(
        sum(int(row[-1]) for name, row in before.items() if name not in {"all", "campaign"})
    )
    results["decks"]["level_nested"]["eyes_with_attitude"]["wrong"] += 2
    results["real"]["webcam"]["eyes_without"]["to_8_m"]["wrong"] += 1
    after = rows_of(tmp_path / "after", "wrong", results)
    assert [int(after[name][-1]) - int(before[name][-1]) for name in ("`decks`", "`real`", "all")] == [2, 1, 3]
