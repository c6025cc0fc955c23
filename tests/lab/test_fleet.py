"""Many aircraft: what a link that is cut must show, and the files of the page about fleets."""

from __future__ import annotations

import re
import tomllib

import pytest

from lab.fleet import claims, longest_gap
from mkdaemon.bus.session import check_endpoint
from mkdaemon.config.root import Config
from tests.places import ROOT

REFUSED = "the router at tcp/1.2.3.4:7447 does not reach vehicle mk2: its link is cut"


@pytest.mark.parametrize(
    ("times", "gap"), [([], 10.0), ([1.0, 9.0], 8.0), ([0.5 * n for n in range(21)], 0.5), ([-5.0, 20.0], 10.0)]
)
def test_a_gap_counts_from_the_edges(times, gap):
    assert longest_gap(times, 0.0, 10.0) == gap


def refusal(took, words=REFUSED, **more):
    return {"asked": "status", "took": took, "words": words, "is_refused": True} | more


RIGHT = {
    "cut_for": 12.0,
    "told_stale": 3.1,
    "told_gone": 2.1,
    "told_back": 1.7,
    "fresh": 1.8,
    "leased_again": 2.5,
    "others": ["here"],
    "others_gap": 0.2,
    "others_lost": 0,
    "refusals": [refusal(1.7), refusal(9.0)],
    "last_setpoint": 0.03,
    "released": 1.0,
    "flown_late": 0,
    "client_told": 3.0,
    "aboard_gap": 0.2,
    "aboard": 80,
    "ground_gap": 12.9,
    "ground_lost": 700,
    "exit_codes": [0, 0, 0],
}
"""What a right cut shows."""


@pytest.mark.parametrize(
    "wrong",
    [
        {"told_stale": None, "told_gone": 5.0},
        {"told_gone": None},
        {"others": ["here", "stale"]},
        {"others_gap": 2.5},
        {"others_lost": 1},
        {"refusals": []},
        {"refusals": [refusal(16.0)]},
        {"refusals": [refusal(1.0, "no daemon")]},
        {"refusals": [refusal(1.0, f"{REFUSED}\nmore")]},
        {"refusals": [refusal(1.0, is_refused=False)]},
        {"released": None},
        {"released": 0.4},
        {"released": 2.5},
        {"flown_late": 1},
        {"client_told": None},
        {"fresh": 30.0},
        {"told_back": None},
        {"leased_again": None},
        {"aboard": 0},
        {"aboard_gap": 12.0},
        {"ground_gap": 3.0},
        {"ground_lost": 0},
        {"exit_codes": [0, -9, 0]},
    ],
)
def test_whatever_a_cut_must_show_and_does_not_is_no_success(wrong):
    assert all(claims(RIGHT).values())
    assert not all(claims(RIGHT | wrong).values())


def test_the_files_on_the_page_about_fleets_are_right_configurations():
    page = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
    files = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL)]
    read = [Config.model_validate(file) for file in files]
    assert [cfg.vehicle.name for cfg in read] == ["mk2", "mk3", "mk2"]
    assert [cfg.bus.connect for cfg in read] == 2 * [("tcp/10.77.0.1:7447",)] + [("tls/10.77.0.1:7447",)]
    for endpoint in (one for cfg in read for one in (*cfg.bus.connect, *cfg.bus.listen)):
        check_endpoint(endpoint, "docs/fleet.md")
