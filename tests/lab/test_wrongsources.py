"""Drawn sources that go wrong: draws cover what they should; one flight beside a second eye goes on by that."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

from lab import wrongsources
from lab.rigs.wrongsourceflight import BEGINS, SECOND, Moment, drawn
from mksim.config import WindClass
from mksim.physics.mocap import FAULTS


def test_two_hundred_draws_have_every_fault_in_every_moment_alone_and_beside_others():
    plans = [drawn(seed) for seed in range(1, 201)]
    assert drawn(7) == drawn(7)
    assert {plan.fault for plan in plans} == set(FAULTS)
    assert set(Counter(plan.moment for plan in plans)) == set(Moment)
    assert min(Counter((plan.other, plan.is_first) for plan in plans).values()) > 15
    assert all(BEGINS[plan.moment][0] - 0.01 <= plan.at <= BEGINS[plan.moment][1] + 0.01 for plan in plans)


def test_a_source_that_jumps_beside_a_second_one_is_named_and_the_flight_lands_by_that_one():
    plan = replace(drawn(1), fault="off", moment=Moment.HOLD, at=16.0, other=SECOND, wind=WindClass.INDOOR)
    row = wrongsources.fly(plan)
    assert (row["ending"], row["why"], row["released"]) == ("finished", "", "")
    assert row["named"] < wrongsources.NAMED_IN_FLIGHT
    assert row["touch_cm"] < 30.0


def test_a_source_may_be_used_when_it_is_back_but_not_while_it_is_named():
    named = [(at, "missing", "silent") for at in (1.0, 1.1, 1.2, 1.3, 2.5)]
    for used, is_broken in (([1.05], False), ([1.25], True), ([1.35, 1.6, 2.45], False), ([], False)):
        assert wrongsources.was_used_while_named(SimpleNamespace(named=named, used=used)) is is_broken


def test_a_source_counts_as_named_since_the_looks_that_named_it_without_a_gap():
    named = [(at, "missing", "silent") for at in (1.0, 1.1, 1.2, 4.0, 4.1, 4.2)]
    rig = SimpleNamespace(named=named, plan=SimpleNamespace(at=0.9))
    found = [wrongsources.named_since(rig, until) for until in (0.5, 1.15, 3.0, 4.15, math.inf)]
    assert found == [0.5, 1.0, 1.0, 4.0, 4.0]
    rig.named = []
    assert wrongsources.named_since(rig, math.inf) == 0.9


def test_kept_flights_are_summed_up_and_a_broken_promise_fails(tmp_path, capsys):
    kept = tmp_path / "wrong.jsonl"
    row = {"why": "", "named": 0.3, "words": "they jumped", "moved": 0.2, "touch_cm": 3.0, "released": ""}
    for ending, code in (("finished", 0), ("released", 0), ("wrong", 1), ("lost", 1)):
        lines = [
            {"campaign": "wrong-sources", "key": wrongsources.FLIGHTS.key(drawn(seed)), "row": row | {"ending": each}}
            for seed, each in ((1, "finished"), (2, ending))
        ]
        kept.write_text("".join(json.dumps(line) + "\n" for line in lines))
        assert wrongsources.main(seeds=2, jobs=1, results=kept, as_json=True) == code
        assert sum(row["flights"] for row in json.loads(capsys.readouterr().out)["rows"]) == 2
