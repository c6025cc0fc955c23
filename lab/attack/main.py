"""`python -m lab attack`: the daemon killed, frozen, ended and flooded in flight, and its guard killed.

Judged by what the simulated FlightCtrl holds and by the bytes on its line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

from lab.attack.attackers import Flood
from lab.attack.deaths import BOARDS, Death, attack, kill_guard
from lab.attack.floods import flood_and_end, ride
from lab.cases import Case, Flight, command, each, largest, part, total

RUNS: Final = 10
ON_TCP: Final = "FC 2.08 on TCP"
FLOODS: Final = (*((kind, False) for kind in Flood if kind is not Flood.HOLDER), (Flood.SETPOINTS, True))
"""And whether the pilot dies under it."""


def _flights(*rows: tuple[str, str, Callable[[int], Any]]) -> Callable[[int | None, int], list[Flight]]:
    """So many flights of each row: the same seed of all rows first, so that flights at a time are different ones."""
    return lambda runs, first: [
        Flight(what, boards, fly, seed) for seed in range(first, first + (runs or RUNS)) for what, boards, fly in rows
    ]


def _most(*names: str) -> dict[str, Callable[[Sequence[Any]], Any]]:
    return {f"{name}_max": largest(name) for name in names}


CASES: Final[Mapping[str, Case]] = {
    "deaths": Case(
        _flights(*((f"daemon {kind}", on.name, partial(attack, on, kind)) for on in BOARDS for kind in Death)),
        {**_most("neutral", "released"), "steered": total("steered")},
    ),
    "floods": Case(
        _flights(
            *(
                (f"{kind}, the pilot dies" if dies else kind.value, ON_TCP, partial(ride, kind, dies=dies))
                for kind, dies in FLOODS
            )
        ),
        {
            "rates": each("rates"),
            "lost": total("lost"),
            **_most("gap_p99", "gap_max", "neutral", "released", "memory_mb", "log"),
        },
        is_alone=True,
    ),
    "backlog": Case(
        _flights(
            *(
                (f"the holder floods, {'killed' if is_killed else 'silent'}", ON_TCP, partial(flood_and_end, is_killed))
                for is_killed in (True, False)
            )
        ),
        _most("neutral", "released"),
        is_alone=True,
    ),
    "guard": Case(
        _flights(("guard killed", ON_TCP, kill_guard)),
        {"noticed_median": part("noticed", 0.5), **_most("noticed"), "lost": total("lost")},
    ),
}

main: Final = command(
    "attack",
    CASES,
    """Attack the daemon in flight; exit code 1 if a limit is broken. Ten runs of everything take about three hours.

    Standard error has how each flight went. One that could not be flown is counted and named, and fails its row.
    """,
    RUNS,
)
