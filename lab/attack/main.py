"""`python -m lab attack`: the daemon killed, frozen and flooded in flight, its guard killed, and a guard that is quiet.

Judged by what the simulated FlightCtrl holds and by the bytes on its line.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Annotated, Any, Final, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from lab.attack.backlog import Backlog, backlog_plans
from lab.attack.deaths import BOARDS, Attack, Death, attack
from lab.attack.flights import AnyFlight, Flights, Plan, fly_all
from lab.attack.floods import Ride, flood_plans
from lab.attack.guardless import GuardDeath, kill_guard
from lab.attack.quiet import FLIGHT, fly_quietly
from lab.attack.virtual import Silence, VirtualDeath, fly_virtually
from lab.rigs.cockpit import Boards
from lab.stories.losses import silence_log
from mkdaemon.cli.arguments import AsJson

Case = Literal["deaths", "virtual", "floods", "backlog", "guard", "quiet"]
Rows = Iterator[dict[str, Any]]
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

    def alone(self) -> Scope:
        """The same, one flight after the other."""
        return replace(self, jobs=1)


def run_deaths(scope: Scope) -> Rows:
    """Every death of the daemon on every pair of boards."""
    plans = [
        Plan(f"daemon {kind.value}", boards.name, partial(attack, boards, kind)) for boards in BOARDS for kind in Death
    ]
    return map(death_row, scope.fly(plans))


def death_row(flights: Flights[Attack]) -> dict[str, Any]:
    """One line of the same death on the same boards."""
    flown = flights.flown
    return _row(
        flights,
        **_ladder(flown),
        steered=sum(one.steered for one in flown),
        machine_late=sum(one.is_machine_late for one in flown),
        machine_late_max_s=_largest(one.late for one in flown),
        on_tcp=sum(one.port == "tcp" for one in flown),
    )


def _ladder(flown: Sequence[Attack] | Sequence[VirtualDeath]) -> dict[str, Any]:
    """When sticks were level, and when the aircraft was released."""
    return {
        "neutral_median_s": _median([one.neutral for one in flown]),
        "neutral_max_s": _largest(one.neutral for one in flown),
        "released_median_s": _median([one.released for one in flown]),
        "released_max_s": _largest(one.released for one in flown),
    }


def run_virtual_deaths(scope: Scope) -> Rows:
    """The daemon's silence in virtual time, on every pair of boards."""
    plans = [
        Plan(f"virtual: {silence.value}", boards.name, partial(fly_virtually, boards, silence))
        for boards in BOARDS
        for silence in Silence
    ]
    return map(virtual_row, scope.fly(plans))


def virtual_row(flights: Flights[VirtualDeath]) -> dict[str, Any]:
    """One line of the same silence on the same boards."""
    flown = flights.flown
    return _row(
        flights,
        **_ladder(flown),
        cut_frames=sum(one.is_cut for one in flown),
    )


def run_floods(scope: Scope) -> Rows:
    """Every flood, one at a time: it is the machine's load itself."""
    return map(flood_row, scope.alone().fly(flood_plans(ON_TCP)))


def flood_row(flights: Flights[Ride]) -> dict[str, Any]:
    """One line of the same flood."""
    flown = flights.flown
    return _row(
        flights,
        rates=[one.rates for one in flown],
        kept=sum(one.kept for one in flown),
        gap_p99_max_s=_largest(one.gap_p99 for one in flown),
        gap_max_s=_largest(one.gap_max for one in flown),
        neutral_max_s=_largest(one.neutral for one in flown if one.neutral is not None),
        released_max_s=_largest(one.released for one in flown),
        memory_max_mb=_largest(one.memory_mb for one in flown),
        log_max_bytes_per_s=_largest(one.log for one in flown),
    )


def run_backlogs(scope: Scope) -> Rows:
    """Floods of the holder, one at a time."""
    return map(backlog_row, scope.alone().fly(backlog_plans(ON_TCP)))


def backlog_row(flights: Flights[Backlog]) -> dict[str, Any]:
    """One line of the same flood and end."""
    flown = flights.flown
    return _row(
        flights,
        neutral_max_s=_largest(one.neutral for one in flown),
        released_max_s=_largest(one.released for one in flown),
        lost_before=sum(one.lost_before for one in flown),
        rates=[one.rate for one in flown],
    )


def run_guard_deaths(scope: Scope) -> Rows:
    """The guard is killed."""
    return map(guard_row, scope.fly([Plan("guard killed", ON_TCP, kill_guard)]))


def guard_row(flights: Flights[GuardDeath]) -> dict[str, Any]:
    """The line of the killed guards."""
    flown = flights.flown
    return _row(
        flights,
        noticed_median_s=_median([one.noticed for one in flown]),
        noticed_max_s=_largest(one.noticed for one in flown),
        machine_late=sum(one.is_machine_late for one in flown),
        machine_late_max_s=_largest(one.late for one in flown),
        kept=sum(one.kept for one in flown),
        refused=sum(one.token is not None for one in flown),
    )


def _row(flights: Flights[Any], **figures: Any) -> dict[str, Any]:
    """A line with its figures; a flight that was not flown is as wrong as one that breaks a limit."""
    wrong = [asdict(one) for one in flights.flown if one.is_wrong]
    return {
        "attack": flights.attack,
        "boards": flights.boards,
        "runs": len(flights.flown) + len(flights.not_flown),
        "not_flown": len(flights.not_flown),
        **figures,
        "wrong": wrong + flights.not_flown,
    }


def _largest(values: Iterable[float]) -> float | None:
    return max(values, default=None)


def _median(values: Sequence[float]) -> float | None:
    return sorted(values)[math.ceil(len(values) / 2) - 1] if values else None


def run_quiet_flights(scope: Scope) -> Rows:
    """Flights with faults of the line that the guard has no part in."""
    for boards in QUIET_BOARDS:
        if scope.has(QUIET, boards.name):
            found = fly_quietly(boards, scope.seeds)
            yield {"attack": QUIET, "runs": len(scope.seeds), **asdict(found), "wrong": found.written}


_CASES: Final[dict[str, Callable[[Scope], Rows]]] = {
    "deaths": run_deaths,
    "virtual": run_virtual_deaths,
    "floods": run_floods,
    "backlog": run_backlogs,
    "guard": run_guard_deaths,
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
