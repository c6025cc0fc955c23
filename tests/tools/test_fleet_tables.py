"""docs/lab/scale.md, of what `lab fleet` found."""

from __future__ import annotations

import json

from lab.fleet.scale import Counted
from tools.docs import FILLED, make_page

PAGE = "docs/lab/scale.md"
RESULTS = FILLED[PAGE].results


def test_the_page_has_the_figures_of_the_results_and_keeps_its_prose(tmp_path):
    times = dict.fromkeys(("told_stale", "last_setpoint", "client_told", "fresh", "leased_again"))
    numbers = dict.fromkeys(("others_gap", "others_lost", "aboard", "aboard_gap", "ground_gap", "ground_lost"), 0)
    cut = times | numbers | {"cut_for": 12.0, "loss": 0.05, "delay": 0.03, "told_gone": 2.12, "others": ["here"]}
    cut |= {"released": 1.04, "reason": "no setpoint for 1.0 s", "client_words": ""}
    cut["refusals"] = [{"asked": "mkctl --vehicle mk2 status", "took": 1.5, "words": "the router | does not\nreach it"}]
    counted = Counted()
    counted.take("mk/mk1/health", b"x" * 99, 0.0)
    used = {"daemon_cpu_percent": 10.0, "simulator_cpu_percent": 14.0, "router_cpu_percent": 2.0}
    row = {"vehicles": 1, "daemon_mb": 61.0, "router_mb": 20.0} | used | counted.figures(1, 5.0)
    results = {"cut": cut, "scale": {"rows": [row], "machine": {"cores": 2, "load_at_the_end": 1.5}}}
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
