"""`python -m lab attack`: the daemon killed, frozen and flooded in flight, its guard killed, and a guard that is quiet.

Judged by what the simulated FlightCtrl holds and by the bytes on its line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

from lab.attack.attackers import Flood
from lab.attack.backlog import ENDS, RATES, flood_and_end
from lab.attack.deaths import BOARDS, Death, attack
from lab.attack.floods import ride
from lab.attack.guardless import kill_guard
from lab.attack.quiet import fly_quietly
from lab.attack.virtual import Silence, fly_virtually
from lab.cases import Case, Figure, Flight, command, each, largest, part, total
from lab.rigs.cockpit import Boards

RUNS: Final = 10
ON_TCP: Final = "FC 2.08 on TCP"
QUIET_BOARDS: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"), Boards("2.12a", "0.24"))
DEADLY: Final = (Flood.SETPOINTS, Flood.STEADY)
"""Floods under which the pilot also dies."""


def _flights(rows: Sequence[tuple[str, str, Callable[[int], Any]]]) -> Callable[[int | None, int], list[Flight]]:
    """So many flights of each row: the same seed of all rows first, so that flights at a time are different ones."""
    return lambda runs, first: [
        Flight(what, boards, fly, seed) for seed in range(first, first + (runs or RUNS)) for what, boards, fly in rows
    ]


LADDER: Final[Mapping[str, Figure]] = {
    "neutral_median_s": part("neutral", 0.5),
    "neutral_max_s": largest("neutral"),
    "released_median_s": part("released", 0.5),
    "released_max_s": largest("released"),
}
"""When sticks were level, and when the aircraft was released."""
LATE: Final[Mapping[str, Figure]] = {"machine_late": total("is_machine_late"), "machine_late_max_s": largest("late")}
CASES: Final[Mapping[str, Case]] = {
    "deaths": Case(
        _flights([(f"daemon {kind}", on.name, partial(attack, on, kind)) for on in BOARDS for kind in Death]),
        {**LADDER, "steered": total("steered"), **LATE},
    ),
    "virtual": Case(
        _flights([(f"virtual: {way}", on.name, partial(fly_virtually, on, way)) for on in BOARDS for way in Silence]),
        {**LADDER, "cut_frames": total("is_cut")},
    ),
    "floods": Case(
        _flights(
            [
                (f"{kind}, the pilot dies" if dies else kind.value, ON_TCP, partial(ride, kind, dies=dies))
                for kind in Flood
                for dies in ((False, True) if kind in DEADLY else (False,))
            ]
        ),
        {
            "rates": each("rates"),
            "kept": total("kept"),
            **{f"{name}_max": largest(name)
               for name in ("gap_p99", "gap_max", "neutral", "released", "memory_mb", "log")},
        },
        is_alone=True,
    ),
    "backlog": Case(
        _flights(
            [
                (f"the holder floods {f'{rate:g}/s' if rate else 'at full rate'}, {end}", ON_TCP,
                 partial(flood_and_end, rate, end))
                for rate in RATES
                for end in ENDS
            ]
        ),
        {"neutral_max_s": largest("neutral"), "released_max_s": largest("released"),
         "lost_before": total("lost_before"), "rates": each("rate")},
        is_alone=True,
    ),
    "guard": Case(
        _flights([("guard killed", ON_TCP, kill_guard)]),
        {"noticed_median_s": part("noticed", 0.5), "noticed_max_s": largest("noticed"), **LATE, "kept": total("kept")},
    ),
    "quiet": Case(
        _flights([("none: the guard is quiet", on.name, partial(fly_quietly, on)) for on in QUIET_BOARDS]),
        {name: total(name) for name in ("hours", "faults", "leases")},
        longest=36000.0,
    ),
}  # fmt: skip

main: Final = command(
    "attack",
    CASES,
    """Attack the daemon in flight; exit code 1 if a limit is broken. Ten runs of everything take about three hours.

    Standard error has how each flight went. One that could not be flown is counted and named, and fails its row.
    """,
    RUNS,
)
