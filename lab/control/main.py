"""`python -m lab control`: hover, steps, landings and faults of the estimator and the autopilot, in virtual time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.campaign import Campaign, Ending, First, Jobs, Kept, Row, summed_up
from lab.control.cases import CASES, REPORTING, Case
from lab.control.faultflights import run_faults
from lab.control.triggers import run_triggers
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError

VIRTUAL: Final = {"faults": run_faults, "triggers": run_triggers}
"""Campaigns that sum up in their own way."""
ALL: Final = (*CASES, *VIRTUAL)
"""What can be asked for."""
ABOUT: Final = ("case", "seed", "ending", "why", "processor_s")
"""What a row has beside its figures."""
WORST: Final = 3.0
"""A worst beyond so many times the goal fails a case, whatever else it reached."""


def main(
    *,
    case: Annotated[str | None, Parameter(help="One case instead of all.")] = None,
    runs: Annotated[int | None, Parameter(help="Flights of every case, in place of each case's own.")] = None,
    first: First = REPORTING,
    jobs: Jobs = 2,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Fly the cases. All of them take about an hour of one core.

    Every figure comes with its median, nine tenths and the largest.

    Raises:
        ConfigError: there is no such case.
    """
    if case is not None and case not in ALL:
        raise ConfigError(f"no case {case!r}: choose from {', '.join(ALL)}")
    found: dict[str, Any] = {}
    for name in ALL if case is None else (case,):
        run = VIRTUAL[name] if name in VIRTUAL else partial(run_case, name)
        found |= run(runs, first, jobs, results)
    return show([{"figure": key} | figure for key, figure in found.items()], ("figure",), as_json=as_json)


def run_case(name: str, runs: int | None, first_seed: int, jobs: int, results: Path | None = None) -> dict[str, Row]:
    """Fly a case; its summary under its name."""
    asked = [(name, first_seed + k) for k in range(runs or CASES[name].flights)]
    return {name: sum_up(CASES[name], FLIGHTS.rows(asked, jobs, results))}


def measure(job: tuple[str, int]) -> Row:
    """Fly one flight of a case: how it ended and why, and its figures; `HELD` did not do what it was flown for."""
    name, seed = job
    case = CASES[name]
    record = case.rig(case.flight(seed)).fly()
    row = {"why": ""} | case.measure(record)
    if record.lost:
        return row | {"ending": Ending.LOST, "why": record.lost}
    return row | {"ending": Ending.HELD if row["why"] else Ending.FINISHED}


FLIGHTS: Final = Campaign("control", measure, lambda job: {"case": job[0], "seed": job[1]})


def sum_up(case: Case, rows: Sequence[Row]) -> Row:
    """What the flights of a case say together; a lost aircraft breaks it, and a worst far beyond a goal."""
    found = summed_up(rows, *dict.fromkeys(key for row in rows for key in row if key not in ABOUT))
    near = all(
        found[key][str(share)] <= most and found[key]["1.0"] <= WORST * most if found.get(key) else False
        for key, (share, most) in case.goals.items()
    )
    ends = [row["ending"] for row in rows]
    flown = set(ends) <= {Ending.FINISHED, Ending.HELD} and ends.count(Ending.FINISHED) >= case.finishing * len(rows)
    return found | {"goals": dict(case.goals), "holds": near and flown}
