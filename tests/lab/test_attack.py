"""What the campaign of attacks makes of its runs, and the guard that is quiet."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from lab.attack import flights as flights_of
from lab.attack import quiet
from lab.attack.deaths import Attack
from lab.attack.flights import Flights, Plan, fly_all
from lab.attack.floods import Ride
from lab.attack.guardless import GuardDeath
from lab.attack.main import death_row, flood_row, guard_row
from lab.attack.virtual import Silence, fly_virtually
from lab.rigs.cockpit import Boards
from lab.stories.losses import silence_log

RIDE = Ride("setpoints", ("1000", "1000"), 0.02, 0.03, 0.04, True, 0.1, 100.0, 90.0, 1.0)


def test_a_row_names_the_deaths_that_break_a_limit():
    flown = [Attack("FC 2.08", "killed", "pty", 0.03, 0.05, 0), Attack("FC 2.08", "killed", "pty", 0.03, 1.2, 0)]
    row = death_row(Flights("daemon killed", "FC 2.08", flown))
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
    assert bool(flood_row(Flights("setpoints", "FC 2.08", [RIDE, found]))["wrong"]) is is_wrong


def test_a_guard_whose_death_is_not_said_is_wrong():
    found = [GuardDeath(0.1, "guard_dead", True), GuardDeath(0.1, None, True)]
    row = guard_row(Flights("guard killed", "FC 2.08", found))
    assert row["refused"] == 1
    assert len(row["wrong"]) == 1


def test_a_flight_that_fails_is_counted_and_costs_no_other_its_result(capsys):
    async def fly(seed):
        if seed == 2:
            raise TimeoutError("not within 30 s")
        return Attack("FC 2.08", "killed", "pty", 0.03, 0.05, 0)

    [flights] = fly_all([Plan("daemon killed", "FC 2.08", fly)], range(1, 4))
    row = death_row(flights)
    assert (row["runs"], row["not_flown"], row["released_max_s"]) == (3, 1, 0.05)
    assert row["wrong"] == [{"seed": 2, "reason": "TimeoutError: not within 30 s"}]
    told = capsys.readouterr().err.splitlines()
    assert [line.partition(" (")[0] for line in told] == [
        "daemon killed, FC 2.08, seed 1: holds",
        "daemon killed, FC 2.08, seed 2: NOT FLOWN: TimeoutError: not within 30 s",
        "daemon killed, FC 2.08, seed 3: holds",
    ]


def test_a_row_of_which_nothing_was_flown_has_no_figures_and_is_wrong():
    row = flood_row(Flights("setpoints", "FC 2.08", [], [{"seed": 1, "reason": "TimeoutError: "}]))
    assert row["gap_max_s"] is None
    assert row["wrong"]


def test_a_flight_without_an_end_is_cut(monkeypatch):
    monkeypatch.setattr(flights_of, "LONGEST", 0.01)

    async def fly(seed):
        await asyncio.sleep(3600)

    [flights] = fly_all([Plan("daemon killed", "FC 2.08", fly)], range(1))
    assert flights.not_flown[0]["seed"] == 0


def test_flights_at_a_time_come_back_in_the_order_of_the_rows():
    async def fly(seed):
        return Attack("FC 2.08", threading.current_thread().name, "pty", 0.001 * seed, 0.05, 0)

    plans = [Plan(name, "FC 2.08", fly) for name in ("killed", "frozen")]
    with ThreadPoolExecutor(2) as pool:
        killed, frozen = fly_all(plans, range(1, 4), pool)
    assert (killed.attack, frozen.attack) == ("killed", "frozen")
    assert [one.neutral for one in killed.flown] == [0.001, 0.002, 0.003]
    assert threading.current_thread().name not in {one.kind for one in killed.flown + frozen.flown}


@pytest.mark.parametrize(("silence", "limit"), [(Silence.CLOSED, 0.1), (Silence.AGED, 0.9)])
async def test_the_guard_releases_in_virtual_time_too(silence, limit):
    found = await fly_virtually(Boards("2.08"), silence, 1)
    assert found.released <= limit
    assert not found.is_wrong


def test_the_guard_is_quiet_in_a_flight_with_faults(monkeypatch):
    silence_log()
    monkeypatch.setattr(quiet, "FLIGHT", 12.0)
    found = quiet.fly_quietly(Boards("2.08"), range(1, 2))
    assert found.written == []
    assert found.leases >= 1
    assert found.hours > 0.001
