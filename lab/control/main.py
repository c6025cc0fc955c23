"""`python -m lab control`: hover, steps, landings and faults of the estimator and the autopilot, in virtual time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.campaign import Campaign, Ending, First, Jobs, Kept, Row, quantile
from lab.control.cases import CASES, REPORTING
from lab.control.faultflights import run_faults
from lab.control.triggers import run_triggers
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError

VIRTUAL: Final = {"faults": run_faults, "triggers": run_triggers}
"""Campaigns in virtual time that sum up in their own way."""
ALL: Final = (*CASES, *VIRTUAL)
"""What can be asked for."""
BY_P90: Final = ("_p90_cm", "_sink", "_overshoot_percent")
"""Figures whose 90th percentile is judged; of the others the median."""
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

    Every figure comes with median, 90th percentile, worst, count and the number of aircraft lost.

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


def run_case(
    name: str, runs: int | None, first_seed: int, jobs: int, results: Path | None = None
) -> dict[str, dict[str, Any]]:
    """Fly a case; figures by key."""
    case = CASES[name]
    asked = [(name, first_seed + k) for k in range(runs or case.flights)]
    rows = FLIGHTS.rows(asked, jobs, results)
    lost = [row["why"] for row in rows if row["ending"] != Ending.FINISHED]
    keys = dict.fromkeys(key for row in rows for key in row.get("figures", ()))
    return {key: sum_up(key, [_value(row, key) for row in rows], lost, case.goals) for key in keys}


def measure(job: tuple[str, int]) -> Row:
    """Fly one flight of a case; its figures without those that are none, how it ended, and why it was lost."""
    name, seed = job
    case = CASES[name]
    record = case.rig(case.flight(seed)).fly()
    figures = {key: value for key, value in case.measure(record).items() if not math.isnan(value)}
    return {"ending": Ending.LOST if record.lost else Ending.FINISHED, "why": record.lost, "figures": figures}


FLIGHTS: Final = Campaign("control", measure, lambda job: {"case": job[0], "seed": job[1]})


def _value(row: Mapping[str, Any], key: str) -> float:
    """A figure of a row: infinite for what never happened, not a number where there is none."""
    value = row.get("figures", {}).get(key, math.nan)
    return math.inf if value is None else float(value)


def sum_up(key: str, values: list[float], lost: list[str], goals: dict[str, float]) -> dict[str, Any]:
    """One figure of many flights; a lost aircraft breaks the goal of every other one.

    A value that is infinite, of what never happened, counts as the worst there is; it is shown as None.
    """
    known = sorted(value for value in values if not math.isnan(value))
    share = key.endswith("_percent") and not key.startswith("step")
    figure: dict[str, Any] = {
        "median": _shown(quantile(known, 0.5)),
        "p90": _shown(quantile(known, 0.9)),
        "worst": _shown(quantile(known, 1.0)),
        "never": sum(map(math.isinf, known)),
        "count": len(values),
        "lost": len(lost),
    }
    if share:
        figure["mean"] = _shown(sum(known) / len(known))
    goal = goals.get(key)
    judged = figure["mean"] if share else figure["p90" if key.endswith(BY_P90) else "median"]
    figure["goal"] = goal
    if goal is None:
        figure["holds"] = True
    elif share:
        figure["holds"] = judged >= goal if key.endswith("success_percent") else judged <= goal
    else:
        is_near = judged is not None and judged <= goal and known[-1] <= WORST * goal
        figure["holds"] = is_near and not lost
    return figure


def _shown(value: float) -> float | None:
    return round(value, 2) if math.isfinite(value) else None
