"""What the campaign of attacks makes of its runs, and the guard that is quiet."""

from __future__ import annotations

import pytest

from lab.attack import quiet
from lab.attack.deaths import Attack
from lab.attack.floods import Ride
from lab.attack.guardless import GuardDeath
from lab.attack.main import death_row, flood_row, guard_row
from lab.rigs.cockpit import Boards
from lab.stories.losses import silence_log

RIDE = Ride("setpoints", ("1000", "1000"), 0.02, 0.03, 0.04, True, 0.1, 100.0, 90.0, 1.0)


def test_a_row_names_the_deaths_that_break_a_limit():
    row = death_row([Attack("FC 2.08", "killed", 0.03, 0.05, 0), Attack("FC 2.08", "killed", 0.03, 1.2, 0)])
    assert row["released_max_s"] == 1.2
    assert [one["released"] for one in row["wrong"]] == [1.2]


@pytest.mark.parametrize(
    ("changed", "is_wrong"),
    [
        ({}, False),
        ({"gap_p99": 0.07}, True),
        ({"kept": False}, True),
        ({"released": 3.0}, True),
        ({"memory_mb": 151.0}, True),
        ({"log": 11_000.0}, True),
    ],
)
def test_a_ride_is_wrong_where_one_limit_is_broken(changed, is_wrong):
    found = Ride(**{field: getattr(RIDE, field) for field in Ride.__slots__} | changed)
    assert bool(flood_row([RIDE, found])["wrong"]) is is_wrong


def test_a_guard_whose_death_is_not_said_is_wrong():
    row = guard_row([GuardDeath(0.1, "guard_dead", True), GuardDeath(0.1, None, True)])
    assert row["refused"] == 1
    assert len(row["wrong"]) == 1


def test_the_guard_is_quiet_in_a_flight_with_faults(monkeypatch):
    silence_log()
    monkeypatch.setattr(quiet, "FLIGHT", 12.0)
    found = quiet.fly_quietly(Boards("2.08"), range(1, 2))
    assert found.written == []
    assert found.leases >= 1
    assert found.hours > 0.001
