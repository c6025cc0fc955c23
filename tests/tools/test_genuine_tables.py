"""The tables of the proving ground's pages, of what it flew."""

from __future__ import annotations

import pytest

from lab.campaign import Results, plain
from tools.docs import FILLED, make_page
from tools.markdown import PLACE

RESULTS = FILLED["docs/lab/genuine.md"].results


@pytest.fixture
def tree(tmp_path):
    """A tree with both pages, one flight of genuine firmware and one of simulated boards, and two with triggers."""
    (tmp_path / RESULTS).parent.mkdir(parents=True)
    (tmp_path / "docs/lab").mkdir()
    (tmp_path / "docs/lab/genuine.md").write_text("By hand.\n<!-- table scenes -->\nwas here\n<!-- end -->\n")
    (tmp_path / "docs/lab/genuine-triggers.md").write_text("<!-- table triggers -->\n<!-- end -->\n")
    results = Results(tmp_path / RESULTS)
    about = {"line": "cable", "seed": 7, "lost": []}
    late = "/dev/x: degraded: fc attitude is overdue"
    results.add("hil scenes", {}, about | {"board": "fork", "hold_cm": 2.0, "light_cm": 9.0, "warnings": [late, late]})
    results.add("hil scenes", {}, about | {"board": "simulated", "hold_cm": 3.0, "lost": ["fell"], "warnings": []})
    for level in (0.3, float("inf")):
        found = {"level": level, "released": 1.0, "missed": []}
        results.add("hil triggers", {}, plain({"board": "fork", "stories": {"client_frozen": found}}))
    return tmp_path


def test_genuine_and_simulated_boards_stand_side_by_side_and_misses_are_bold(tree):
    page = make_page("docs/lab/genuine.md", tree)
    assert page.startswith("By hand.\n")
    assert "was here" not in page
    assert "| median / p90 / worst | genuine by cable | simulated by cable | goal by cable | goal by radio |" in page
    assert "| hold, indoor air [cm] | 2.00 / 2.00 / 2.00 | 3.00 / 3.00 / 3.00 | median 3.2 | median 4.5 |" in page
    assert "| hold, light wind [cm] | **9.00 / 9.00 / 9.00** |  | median 8 | median 8 |" in page
    assert "| lost, or scene not flown | 0 | **1** | 0 | 0 |" in page
    assert "| false warnings | **2.00 / 2.00 / 2.00** | 0.00 / 0.00 / 0.00 |" in page, "a cable loses nothing"
    assert page == PLACE.sub(lambda place: place.group(), page)


def test_a_story_that_is_right_in_some_flights_only_is_bold(tree):
    page = make_page("docs/lab/genuine-triggers.md", tree)
    assert "| client frozen | level | 0.30 / never / never | 0.25 to 0.45 | **1 of 2** |" in page
