"""docs/lab/mutants.md, of what a run found."""

from __future__ import annotations

import json

from lab.mutants.operators import Mutant
from lab.mutants.results import Reason, sum_up
from tests.places import ROOT
from tools.docs import FILLED, make_page

PAGE = "docs/lab/mutants.md"


def test_the_page_has_the_share_of_each_subject_and_each_survivor_with_its_reason(tmp_path):
    mutants = [
        Mutant(f"src/mkdaemon/{file}", line, 4, "compare", "f", line, False, "a < b", becomes)
        for file in ("control/x.py", "guard.py")
        for line, becomes in ((1, "a >= b"), (2, "a <= b"))
    ]
    outcomes = ["killed", "survived", "killed", "survived"]
    verdicts = {m.id: {"outcome": how, "by": "", "seconds": 60.0} for m, how in zip(mutants, outcomes, strict=True)}
    reasons = [Reason("src/mkdaemon/guard.py", "f", "a < b", "a <= b", "never equal", is_equivalent=True)]
    found = sum_up(mutants, verdicts, reasons, lambda path: path.split("/")[2])
    summary = {
        "seed": 29,
        "sample": 2,
        "budget": 5.0,
        "of": {"src/mkdaemon/control": 9, "src/mkdaemon/guard.py": 2},
        **found,
    }
    results = tmp_path / FILLED[PAGE].results
    for path in (results, tmp_path / PAGE):
        path.parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / PAGE).write_text((ROOT / PAGE).read_text(encoding="utf-8"), encoding="utf-8")
    results.write_text(json.dumps(summary), encoding="utf-8")
    page = make_page(PAGE, tmp_path)
    assert "Of each subject 2 were drawn with seed 29 (`control` has 9, `guard.py` has 2)" in page
    assert "2 of 4 killed" in page
    assert "took 4 minutes of computing time" in page
    assert "took 5 s at most" in page
    assert "the same: never equal" in page
    assert "no test yet" in page
    assert "before it came" not in page
    [control] = [line for line in page.splitlines() if line.startswith("| control ")]
    assert [cell.strip() for cell in control.split("|")[-3:-1]] == ["1", "50.0 %"]

    results.write_text(json.dumps(summary | {"sample": 3}), encoding="utf-8")
    assert "The run was stopped before it came to the other 1 of its sample" in make_page(PAGE, tmp_path)
