"""The page of mutants shows every survivor with its reason."""

from __future__ import annotations

import json

from tools.mutants_page import mutants_page

COUNT = {"mutants": 3, "killed": 2, "timeouts": 0, "equivalent": 0, "survived": 1, "share": 0.6667}
FOUND = {
    "seed": 29,
    "sample": 3,
    **COUNT,
    "files": {"src/mkdaemon/guard.py": COUNT},
    "operators": {"boolean": COUNT},
    "survivors": [
        {
            "id": "src/mkdaemon/guard.py:3:4:boolean",
            "scope": "f",
            "was": "a | b",
            "becomes": "a & b",
            "reason": "nobody asks",
            "equivalent": False,
        }
    ],
}


def test_counts_and_survivors_are_shown(tmp_path):
    (tmp_path / "docs" / "results").mkdir(parents=True)
    (tmp_path / "docs" / "results" / "mutants.json").write_text(json.dumps(FOUND), encoding="utf-8")
    page = mutants_page(tmp_path)
    assert "A sample of 3 drawn with seed 29: 2 of 3 killed" in page
    assert "| guard.py | 3 | 2 | 0 | 1 | 66.7 % |" in page
    assert "| `guard.py:3:4:boolean` | `a \\| b` | `a & b` | nobody asks |" in page
