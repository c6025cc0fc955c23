"""`python -m lab attack`: the daemon killed, frozen and flooded in flight, its guard killed, and a guard that is quiet.

Judged by what the simulated FlightCtrl holds and by the bytes on its line.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import Annotated, Any, Final, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from lab.attack.attackers import Flood
from lab.attack.deaths import BOARDS, Attack, Death, attack
from lab.attack.floods import Ride, ride
from lab.attack.guardless import GuardDeath, kill_guard
from lab.attack.quiet import FLIGHT, fly_quietly
from lab.rigs.cockpit import Boards
from lab.stories.losses import silence_log
from mkdaemon.cli.arguments import AsJson

Case = Literal["deaths", "floods", "guard", "quiet"]
Rows = Iterator[dict[str, Any]]
QUIET_BOARDS: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"), Boards("2.12a", "0.24"))


def run_deaths(runs: int, seed: int) -> Rows:
    """Every death of the daemon on every pair of boards."""
    for fc, nc in BOARDS:
        for kind in Death:
            found = [asyncio.run(attack(fc, nc, kind, seed=seed + k)) for k in range(runs)]
            yield death_row(found)


def death_row(found: Sequence[Attack]) -> dict[str, Any]:
    """One line of the same death on the same boards."""
    released = sorted(one.released for one in found)
    return {
        "attack": f"daemon {found[0].kind}",
        "boards": found[0].boards,
        "runs": len(found),
        "neutral_max_s": max(one.neutral for one in found),
        "released_median_s": released[math.ceil(len(found) / 2) - 1],
        "released_max_s": released[-1],
        "steered": sum(one.steered for one in found),
        "wrong": [asdict(one) for one in found if one.is_wrong],
    }


def run_floods(runs: int, seed: int) -> Rows:
    """Every flood."""
    for kind in Flood:
        yield flood_row([asyncio.run(ride(kind, seed=seed + k)) for k in range(runs)])


def flood_row(found: Sequence[Ride]) -> dict[str, Any]:
    """One line of the same flood."""
    return {
        "attack": found[0].kind,
        "boards": "FC 2.08 on TCP",
        "runs": len(found),
        "rates": [one.rates for one in found],
        "kept": sum(one.kept for one in found),
        "gap_p99_max_s": max(one.gap_p99 for one in found),
        "gap_max_s": max(one.gap_max for one in found),
        "released_max_s": max(one.released for one in found),
        "memory_max_mb": max(one.memory_mb for one in found),
        "log_max_bytes_per_s": max(one.log for one in found),
        "wrong": [asdict(one) for one in found if one.is_wrong],
    }


def run_guard_deaths(runs: int, seed: int) -> Rows:
    """The guard is killed."""
    yield guard_row([asyncio.run(kill_guard(seed=seed + k)) for k in range(runs)])


def guard_row(found: Sequence[GuardDeath]) -> dict[str, Any]:
    """The line of the killed guards."""
    return {
        "attack": "guard killed",
        "boards": "FC 2.08 on TCP",
        "runs": len(found),
        "noticed_max_s": max(one.noticed for one in found),
        "kept": sum(one.kept for one in found),
        "refused": sum(one.token is not None for one in found),
        "wrong": [asdict(one) for one in found if one.is_wrong],
    }


def run_quiet_flights(runs: int, seed: int) -> Rows:
    """Flights with faults of the line that the guard has no part in."""
    for boards in QUIET_BOARDS:
        found = fly_quietly(boards, range(seed, seed + runs))
        yield {"attack": "none: the guard is quiet", "runs": runs, **asdict(found), "wrong": found.written}


_CASES: Final[dict[str, Callable[[int, int], Rows]]] = {
    "deaths": run_deaths,
    "floods": run_floods,
    "guard": run_guard_deaths,
    "quiet": run_quiet_flights,
}


def main(
    *,
    case: Annotated[Case | None, Parameter(help="One case; all by default.")] = None,
    runs: Annotated[int, Parameter(help="Runs of every row.")] = 10,
    seed: Annotated[int, Parameter(help="Of the first run; run k has seed + k.")] = 1,
    as_json: AsJson = False,
) -> int:
    """Attack the daemon in flight; exit code 1 if a limit is broken. Ten runs of everything take about two hours.

    The last line of `--json` is one object; every row has the load of the machine when it ended.
    """
    silence_log()
    rows = []
    for name in _CASES if case is None else (case,):
        for row in _CASES[name](runs, seed):
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
