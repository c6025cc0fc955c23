"""docs/lab/scale.md, of what `lab fleet` found."""

from __future__ import annotations

import json

from lab.fleet.findings import CutFindings, Refusal
from lab.fleet.scale import Counted, figures
from tools.docs import FILLED, make_page

PAGE = "docs/lab/scale.md"
RESULTS = FILLED[PAGE].results


def test_the_page_has_the_figures_of_the_results_and_keeps_its_prose(tmp_path):
    cut = CutFindings(12.0, 0.05, 0.03, told_gone=2.12, released=1.04, reason="no setpoint for 1.0 s", others={"here"})
    cut.refusals = [Refusal("mkctl --vehicle mk2 status", 4.0, 1.5, "the router | does not\nreach it", True, True)]
    counted = Counted()
    counted.take("mk/mk1/health", b"x" * 99, 0.0)
    used = {"daemons": 0.5, "simulators": 0.7, "router": 0.1, "client": 0.2}
    row = figures(1, 5.0, counted, used, {"daemon": 61.0, "simulator": 55.0, "router": 20.0})
    results = {"cut": cut.row(), "scale": {"rows": [row], "machine": {"cores": 2, "load_at_the_end": 1.5}}}
    for path, text in (
        (RESULTS, json.dumps(results)),
        (PAGE, "Prose.\n" + "".join(f"<!-- table {n} -->\nold\n<!-- end -->\n" for n in ("cut", "scale", "bandwidth"))),
    ):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    page = make_page(PAGE, tmp_path)
    assert page.startswith("Prose.")
    assert "old" not in page
    for words in (
        "| release on the wire | 1.04 s after that setpoint: no setpoint for 1.0 s |",
        "| the fleet view says stale, and gone | never, 2.12 s after the cut |",
        "| mkctl --vehicle mk2 status | 1.50 s: the router \\| does not reach it |",
        "5 % lost each way, 60 ms there and back, cut for 12.00 s",
        "2 cores, load 1.5",
        "| 1 | 10 | 14 | 2 | 61 | 20 |",
        "| `mkctl top --all` | 0.02 |",
    ):
        assert words in page, words
