"""`python -m lab attack`: the daemon killed, frozen and flooded in flight, its guard killed, and a guard that is quiet.

Judged by what the simulated FlightCtrl holds and by the bytes on its line.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Annotated, Any, Final, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from lab.attack.backlog import backlog_plans
from lab.attack.deaths import BOARDS, Death, attack
from lab.attack.flights import AnyFlight, Flights, Plan, fly_all
from lab.attack.floods import flood_plans
from lab.attack.guardless import kill_guard
from lab.attack.quiet import FLIGHT, fly_quietly
from lab.attack.virtual import Silence, fly_virtually
from lab.rigs.cockpit import Boards
from lab.stories.losses import silence_log
from mkdaemon.cli.arguments import AsJson

Case = Literal["deaths", "virtual", "floods", "backlog", "guard", "quiet"]
Rows = Iterator[dict[str, Any]]
Figure = Callable[[Sequence[Any]], Any]
"""One figure of the flights of a row."""
QUIET: Final = "none: the guard is quiet"
ON_TCP: Final = "FC 2.08 on TCP"
QUIET_BOARDS: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"), Boards("2.12a", "0.24"))


@dataclass(frozen=True, slots=True)
class Scope:
    """Which flights are flown, and how.

    Attributes:
        seeds: one per flight of a row.
        jobs: flights at a time.
        only: rows whose attack and boards hold this.
    """

    seeds: range
    jobs: int = 1
    only: str = ""

    def has(self, attack: str, boards: str) -> bool:
        """Whether a row is flown."""
        return self.only in f"{attack}, {boards}"

    def fly(self, plans: Sequence[Plan[AnyFlight]]) -> Iterator[Flights[AnyFlight]]:
        """Fly those of the rows that are chosen; see `fly_all`."""
        return fly_all([plan for plan in plans if self.has(plan.attack, plan.boards)], self.seeds, self.jobs)


def largest(name: str) -> Figure:
    """The largest of what flights came to under a name."""
    return lambda flown: max((value for one in flown if (value := getattr(one, name)) is not None), default=None)


def median(name: str) -> Figure:
    """The median of it; of an even number the lower of the two in the middle."""
    return lambda flown: sorted(getattr(one, name) for one in flown)[math.ceil(len(flown) / 2) - 1] if flown else None


def total(name: str) -> Figure:
    """The sum of it; of claims how many hold."""
    return lambda flown: sum(getattr(one, name) for one in flown)


def each(name: str) -> Figure:
    """All of it."""
    return lambda flown: [getattr(one, name) for one in flown]


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the campaign: what is flown, and what is said of it.

    Attributes:
        plans: its rows.
        figures: of a row, from the flights that were flown.
        is_alone: one flight at a time: it is the machine's load itself.
    """

    plans: Callable[[], Sequence[Plan[Any]]]
    figures: Mapping[str, Figure]
    is_alone: bool = False

    def rows(self, scope: Scope) -> Rows:
        """Fly, and give a row for each plan."""
        return map(self.row, (replace(scope, jobs=1) if self.is_alone else scope).fly(self.plans()))

    def row(self, flights: Flights[Any]) -> dict[str, Any]:
        """A row with its figures; a flight that was not flown is as wrong as one that breaks a limit."""
        wrong = [asdict(one) for one in flights.flown if one.is_wrong]
        return {
            "attack": flights.attack,
            "boards": flights.boards,
            "runs": len(flights.flown) + len(flights.not_flown),
            "not_flown": len(flights.not_flown),
            **{name: figure(flights.flown) for name, figure in self.figures.items()},
            "wrong": wrong + flights.not_flown,
        }


LADDER: Final[Mapping[str, Figure]] = {
    "neutral_median_s": median("neutral"),
    "neutral_max_s": largest("neutral"),
    "released_median_s": median("released"),
    "released_max_s": largest("released"),
}
"""When sticks were level, and when the aircraft was released."""
LATE: Final[Mapping[str, Figure]] = {"machine_late": total("is_machine_late"), "machine_late_max_s": largest("late")}
DEATHS: Final = Part(
    lambda: [Plan(f"daemon {kind.value}", on.name, partial(attack, on, kind)) for on in BOARDS for kind in Death],
    {**LADDER, "steered": total("steered"), **LATE, "on_tcp": lambda flown: sum(one.port == "tcp" for one in flown)},
)
"""Every death of the daemon on every pair of boards."""
VIRTUAL: Final = Part(
    lambda: [
        Plan(f"virtual: {silence.value}", boards.name, partial(fly_virtually, boards, silence))
        for boards in BOARDS
        for silence in Silence
    ],
    {**LADDER, "cut_frames": total("is_cut")},
)
"""The daemon's silence in virtual time, on every pair of boards."""
FLOODS: Final = Part(
    lambda: flood_plans(ON_TCP),
    {
        "rates": each("rates"),
        "kept": total("kept"),
        "gap_p99_max_s": largest("gap_p99"),
        "gap_max_s": largest("gap_max"),
        "neutral_max_s": largest("neutral"),
        "released_max_s": largest("released"),
        "memory_max_mb": largest("memory_mb"),
        "log_max_bytes_per_s": largest("log"),
    },
    is_alone=True,
)
"""Every flood."""
BACKLOGS: Final = Part(
    lambda: backlog_plans(ON_TCP),
    {
        "neutral_max_s": largest("neutral"),
        "released_max_s": largest("released"),
        "lost_before": total("lost_before"),
        "rates": each("rate"),
    },
    is_alone=True,
)
"""Floods of the holder."""
GUARD: Final = Part(
    lambda: [Plan("guard killed", ON_TCP, kill_guard)],
    {
        "noticed_median_s": median("noticed"),
        "noticed_max_s": largest("noticed"),
        **LATE,
        "kept": total("kept"),
        "refused": lambda flown: sum(one.token is not None for one in flown),
    },
)
"""The guard is killed."""


def run_quiet_flights(scope: Scope) -> Rows:
    """Flights with faults of the line that the guard has no part in."""
    for boards in QUIET_BOARDS:
        if scope.has(QUIET, boards.name):
            found = fly_quietly(boards, scope.seeds)
            yield {"attack": QUIET, "runs": len(scope.seeds), **asdict(found), "wrong": found.written}


_CASES: Final[dict[str, Callable[[Scope], Rows]]] = {
    "deaths": DEATHS.rows,
    "virtual": VIRTUAL.rows,
    "floods": FLOODS.rows,
    "backlog": BACKLOGS.rows,
    "guard": GUARD.rows,
    "quiet": run_quiet_flights,
}


def main(
    *,
    case: Annotated[Case | None, Parameter(help="One case; all by default.")] = None,
    runs: Annotated[int, Parameter(help="Runs of every row.")] = 10,
    seed: Annotated[int, Parameter(help="Of the first run; run k has seed + k.")] = 1,
    only: Annotated[
        str, Parameter(help="Only rows whose attack and boards, 'daemon killed, FC 2.08', hold this.")
    ] = "",
    jobs: Annotated[int, Parameter(help="Flights at a time; floods and quiet flights have one.")] = 1,
    as_json: AsJson = False,
) -> int:
    """Attack the daemon in flight; exit code 1 if a limit is broken. Ten runs of everything take about three hours.

    Standard error tells how each flight went. One that could not be flown is counted and named, and fails its row.

    The last line of `--json` is one object; every row has the load of the machine when it ended.
    """
    silence_log()
    rows = []
    for name in _CASES if case is None else (case,):
        for row in _CASES[name](Scope(range(seed, seed + runs), jobs, only)):
            rows.append({"case": name, **row, "load": round(os.getloadavg()[0], 1), "holds": not row["wrong"]})
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    holds = all(row["holds"] for row in rows)
    if as_json:
        print(json.dumps({"rows": rows, "flight_s": FLIGHT, "holds": holds}))
    else:
        _print(rows)
    return 0 if holds else 1


def _print(rows: Sequence[dict[str, Any]]) -> None:
    table = Table("attack", "boards", "runs", "measured", "holds")
    for row in rows:
        hidden = {"case", "attack", "boards", "runs", "wrong", "holds", "rates"}
        measured = ", ".join(f"{key} {value}" for key, value in row.items() if key not in hidden)
        table.add_row(row["attack"], row["boards"], str(row["runs"]), measured, "yes" if row["holds"] else "NO")
    Console().print(table)
