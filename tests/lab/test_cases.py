"""Campaigns of several cases: what their rows have, and what makes one fail."""

from __future__ import annotations

import asyncio
import json
import math
from functools import partial

import pytest

from lab.cases import Case, Flight, carry_out, judged, largest, part, percentile, sessions, total
from mkdaemon.errors import ConfigError


def take(wrong, seed):
    return [judged({}, took=0.1 * seed), {"took": None, "is_wrong": seed in wrong}]


async def fail(longest, seed):
    await asyncio.sleep(longest)
    raise TimeoutError("never level")


def _case(fly, longest=300.0):
    def flights(runs, first):
        return [Flight("killed", boards, fly, seed) for seed in range(first, first + runs) for boards in ("a", "b")]

    return Case(flights, {"took": largest("took"), "wrong_ones": total("is_wrong")}, longest=longest)


def _rows(capsys, case, **more):
    ending = carry_out("cases", {"one": case}, None, 3, as_json=True, **more)
    return ending, json.loads(capsys.readouterr().out)["rows"]


def test_a_row_has_the_figures_of_its_group_and_what_is_wrong(capsys):
    ending, [first, second] = _rows(capsys, _case(partial(take, (2,))))
    assert ending == 1
    assert (first["boards"], first["runs"], first["took"], first["holds"]) == ("a", 6, pytest.approx(0.3), False)
    assert first["wrong"] == second["wrong"] == [{"took": None, "is_wrong": True}]


def test_rows_are_chosen_by_what_is_done_and_boards(capsys):
    ending, [only] = _rows(capsys, _case(partial(take, ())), only="killed, b")
    assert (ending, only["boards"]) == (0, "b")


@pytest.mark.parametrize(("sleeps", "longest"), [(0.0, 300.0), (3600.0, 0.01)], ids=["fails", "has no end"])
def test_a_flight_that_could_not_be_flown_fails_its_row(capsys, sleeps, longest):
    ending, [first, _] = _rows(capsys, _case(partial(fail, sleeps), longest))
    assert (ending, first["runs"], len(first["failed"]), first["took"]) == (1, 3, 3, None)
    assert first["failed"][0].startswith("1: TimeoutError")


def test_a_case_that_there_is_not_is_refused():
    with pytest.raises(ConfigError, match="choose from one"):
        carry_out("cases", {"one": _case(take)}, "two")


def test_percentiles_are_values_that_occurred():
    ordered = [float(n) for n in range(1, 1001)]
    assert (percentile(ordered, 0.5), percentile(ordered, 0.999)) == (500, 999)
    assert (percentile([7.0], 0.999), percentile([], 0.5)) == (7, None)
    assert part("took", 0.5)([{"took": 3.0}, {"took": None}, {"took": 1.0}]) == 1.0


def test_the_last_session_has_what_is_left():
    assert sessions(43, 20) == [20, 20, 3]
    assert sessions(2, 20) == [2]


@pytest.mark.parametrize(
    ("changes", "is_wrong"),
    [
        ({}, False),
        ({"late": 0.35, "frames": 0}, False),
        ({"late": 0.351}, True),
        ({"late": None}, True),
        ({"late": math.nan}, True),
        ({"frames": 1}, True),
        ({"held": True}, True),
        ({"first": "sticks"}, True),
        ({"other": 1000}, False),
    ],
)
def test_what_breaks_a_limit_is_wrong(changes, is_wrong):
    found = {"late": 0.1, "frames": 0, "held": False, "first": "release"} | changes
    limits = {"late": 0.35, "frames": 0, "held": False, "first": "release"}
    assert judged(limits, **found) == found | {"is_wrong": is_wrong}
