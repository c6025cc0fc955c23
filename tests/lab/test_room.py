"""Flights from pad to pad: the verdict is that of the physics; what was kept is summed up."""

from __future__ import annotations

import json

import pytest

from lab import room
from lab.demo import landing_of
from mksim.programs.flightrecord import Moment, Rehearsed


def flown(place, *, motors_stand=True, crashed=""):
    moments = [Moment(0.05 * k, place, (0.0, 0.0, 0.0), None, None, "land") for k in range(20)]
    return Rehearsed(
        moments=moments, parts={"land": 0.0}, outcome="it says so", motors_stand=motors_stand, crashed=crashed
    )


@pytest.mark.parametrize(
    ("record", "stands", "is_lost", "ending", "why"),
    [
        (flown((0.03, 0.04, 0.1)), True, False, "finished", ""),
        (flown((0.0, 0.4, 0.1)), True, False, "released", "a reason"),
        (flown((0.0, 0.0, 0.5)), True, False, "released", "a reason"),
        (flown((0.0, 0.0, 0.1)), False, False, "released", "a reason"),
        (flown((0.0, 0.0, 0.1), motors_stand=False), True, False, "released", "a reason"),
        (flown((0.0, 0.0, 0.1)), True, True, "lost", "a reason"),
        (flown((0.0, 0.0, 0.1), crashed="hit the ground"), True, False, "lost", "hit the ground"),
        (Rehearsed(), True, False, "released", "a reason"),
    ],
)
def test_where_it_stands_says_how_it_ended(record, stands, is_lost, ending, why):
    row = landing_of(record, "a reason", stands=stands, is_lost=is_lost)
    assert (row["ending"], row["why"]) == (ending, why)
    assert row["touch_cm"] == (
        None if not record.moments else pytest.approx(100 * abs(complex(*record.moments[0].position[:2])))
    )


def test_kept_flights_are_summed_up_and_the_goal_is_asked(tmp_path, capsys):
    kept = tmp_path / "room.jsonl"
    row = {
        "ending": "finished",
        "why": "",
        "hold_cm": 5.0,
        "midway_cm": 4.0,
        "eight_cm": 6.0,
        "posed": 1.0,
        "seconds": 50.0,
    }
    for worst, code in ((5.0, 0), (9.0, 1)):
        rows = [{"seed": seed, "wind": "light", "fps": 15.0} for seed in (1, 2)]
        lines = [
            {"campaign": "room", "key": key, "row": row | {"touch_cm": touch}}
            for key, touch in zip(rows, (1.0, worst), strict=True)
        ]
        kept.write_text("".join(json.dumps(line) + "\n" for line in lines))
        assert room.main(seeds=2, jobs=1, results=kept, as_json=True) == code
        [found] = json.loads(capsys.readouterr().out)["rows"]
        assert (found["flights"], found["finished"], found["touch_cm"]["1.0"]) == (2, 2, worst)
