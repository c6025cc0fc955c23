"""The rows of the table: a broken limit is never a yes."""

from __future__ import annotations

from dataclasses import replace

from lab.stories.clients import Loss as LostClient
from lab.stories.deaths import Death, Loss
from lab.stories.faults import Verdicts
from lab.stories.kill import End
from lab.stories.losses import summed_up
from lab.stories.main import (
    client_row,
    end_row,
    fault_row,
    loss_row,
    plug_row,
    race_row,
    soak_row,
    unreleased_row,
)
from lab.stories.plug import Replugs
from lab.stories.race import Race
from lab.stories.soak import Soak

GOOD = Loss(1, 0, Death.KILLED, wire=0.02, neutral=0.03, applied=0.04, released=0.05, relapses=0)
BAD = replace(GOOD, wire=None, neutral=None, applied=None, released=None)


def test_deaths_and_their_counter_proof():
    assert loss_row(summed_up("FC 2.08", [GOOD])).line().endswith("| 350 ms; 1100 ms; 0 | yes |")
    row = loss_row(summed_up("FC 2.08", [BAD]))
    assert not row.holds
    assert "longest never" in row.figure
    assert unreleased_row(summed_up("FC 2.08", [BAD])).holds
    assert not unreleased_row(summed_up("FC 2.08", [GOOD])).holds, "a release that is not missed proves nothing"
    assert not unreleased_row(summed_up("FC 2.08", [replace(GOOD, released=2.0)])).holds
    assert unreleased_row(summed_up("FC 2.12a", [replace(GOOD, released=2.0)])).holds


def test_clients_and_daemons():
    assert client_row("FC 2.08", "SIGKILL", [LostClient("SIGKILL", 0.02, 0.03)]).holds
    assert not client_row("FC 2.08", "SIGSTOP", [LostClient("SIGSTOP", 0.36, 1.0)]).holds
    assert not client_row("FC 2.08", "SIGSTOP", [LostClient("SIGSTOP", 0.3, 1.2)]).holds
    killed = End("2.08", "SIGKILL", 0.01, 4.0, "release", 0, 0.01, -9, 0)
    assert end_row([killed]).holds
    assert not end_row([killed, replace(killed, first="v")]).holds
    told = replace(killed, signal="SIGTERM", held=0.1, released=None, exit_code=0)
    assert end_row([told]).holds
    assert not end_row([replace(told, took=2.5)]).holds


def test_lines_and_long_runs():
    assert fault_row(Verdicts("silence", "FC", 2, ("mute",), 400, 0.1, [])).holds
    assert not fault_row(Verdicts("silence", "FC", 2, ("mute",), 600, 0.1, [1])).holds
    assert "stays `up`" in fault_row(Verdicts("one_byte_at_a_time", "FC", 2, ("up",), 0, 0.0, [])).figure
    cycles = Replugs(200, 0.2, 0.9, [], [], (30, 30), (80.0, 80.1), 0)
    assert plug_row(cycles).holds
    assert not plug_row(replace(cycles, back_max=3.2)).holds
    assert not race_row(Race(takes=3, refused=0, frames=9, tilted=5, foreign=1, backwards=0, unseen=0)).holds
    good = Soak(1200.0, 10, 10, 20, 20, {}, 0, (80.0, 80.5), (30, 30), 9.0, 0.0, 0)
    assert soak_row(good).holds
    assert not soak_row(replace(good, cpu_percent=26.0)).holds
    assert not soak_row(replace(good, board_received=19)).holds
