"""Many aircraft: what a link that is cut must show, and the files of the page about fleets."""

from __future__ import annotations

import re
import tomllib

import pytest

from lab.fleet import is_clear, longest_gap
from mkdaemon.bus.session import check_endpoint
from mkdaemon.config.root import Config
from tests.places import ROOT

REFUSED = "the router at tcp/1.2.3.4:7447 does not reach vehicle mk2: its link is cut"


@pytest.mark.parametrize(
    ("times", "gap"), [([], 10.0), ([1.0, 9.0], 8.0), ([0.5 * n for n in range(21)], 0.5), ([-5.0, 20.0], 10.0)]
)
def test_a_gap_counts_from_the_edges(times, gap):
    assert longest_gap(times, 0.0, 10.0) == gap


@pytest.mark.parametrize(
    ("took", "words", "is_refused", "clear"),
    [
        (9.0, REFUSED, True, True),
        (16.0, REFUSED, True, False),
        (1.0, "no daemon", True, False),
        (1.0, f"{REFUSED}\nmore", True, False),
        (1.0, REFUSED, False, False),
    ],
)
def test_a_refusal_is_clear_in_time_and_in_one_line(took, words, is_refused, clear):
    assert is_clear({"took": took, "words": words, "is_refused": is_refused}) is clear


def test_the_files_on_the_page_about_fleets_are_right_configurations():
    page = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
    files = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL)]
    read = [Config.model_validate(file) for file in files]
    assert [cfg.vehicle.name for cfg in read] == ["mk2", "mk3", "mk2"]
    assert [cfg.bus.connect for cfg in read] == 2 * [("tcp/10.77.0.1:7447",)] + [("tls/10.77.0.1:7447",)]
    for endpoint in (one for cfg in read for one in (*cfg.bus.connect, *cfg.bus.listen)):
        check_endpoint(endpoint, "docs/fleet.md")
