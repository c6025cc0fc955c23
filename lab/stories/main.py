"""`python -m lab stories`: the safety stories about link and release, run a thousand times against simulated boards.

Everything in virtual time is seeded and the same on every machine; `soak` runs processes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

from lab.cases import Case, Flight, command, largest, part, sessions, total
from lab.rigs.cockpit import Boards
from lab.stories.cable import pull_cable
from lab.stories.deaths import SESSION, fly_session
from lab.stories.hands import HANDS, Way, lose_hands
from lab.stories.quiet import fly_quietly
from lab.stories.soak import soak
from lab.stories.standstills import Stopped, stand_still

DIRECT: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"))
"""One FlightCtrl of each dead-man generation."""
BEHIND: Final = (Boards("early", "0.24"), Boards("2.08", "0.24"), Boards("2.12a", "0.24"), Boards("2.14", "2.14"))
"""The same behind a NaviCtrl that passes stick frames on, and the newest pair."""
CYCLES: Final = 20
"""Interruptions of the line a session."""
RUNS: Final = 50
"""Of boards or daemons that begin anew."""
STOPS: Final = (1.0, 3.0, 10.0)
"""How long a daemon stands still [s]."""
Flights = Sequence[Flight]


def _deaths(runs: int | None, first: int) -> Flights:
    counts = [(boards, runs or 1000) for boards in DIRECT] + [(boards, runs or 200) for boards in BEHIND]
    return [
        Flight("client dies", boards.name, partial(fly_session, boards, deaths=size), seed)
        for boards, count in counts
        for seed, size in enumerate(sessions(count, SESSION), first)
    ]


def _hands(runs: int | None, first: int) -> Flights:
    return [
        Flight(f"hands lost: {way}", boards.name, partial(lose_hands, boards, way, size), seed)
        for way in Way
        for boards in DIRECT
        for seed, size in enumerate(sessions(runs or 50, HANDS), first)
    ]


def _cuts(runs: int | None, first: int) -> Flights:
    return [
        Flight("cable pulled or board rebooted", boards.name, partial(pull_cable, boards, cycles=size), seed)
        for boards in (*DIRECT, BEHIND[2])
        for seed, size in enumerate(sessions(runs or 200, CYCLES), first - 1)
    ]


def _freezes(runs: int | None, first: int) -> Flights:
    return [
        Flight(f"{who} for {seconds:g} s", boards.name, partial(stand_still, boards, who, seconds, runs or RUNS), first)
        for who in Stopped
        for boards in DIRECT
        for seconds in STOPS
    ]


CASES: Final = {
    "deaths": Case(
        _deaths, {"wire_p999": part("wire", 0.999), "wire": largest("wire"), "released": largest("released"),
                  "relapses": total("relapses")}
    ),
    "hands": Case(
        _hands, {"wire": largest("wire"), "released": largest("released"), "relapses": total("relapses"),
                 "foreign": total("foreign")}
    ),
    "cable": Case(_cuts, {"back": largest("back"), "steered": total("steered"), "obeyed": largest("obeyed")}),
    "freeze": Case(_freezes, {"tilted": total("tilted"), "cleared": largest("cleared")}),
    "quiet": Case(
        lambda runs, first: [
            Flight("the guard is quiet", boards.name, partial(fly_quietly, boards), seed)
            for boards in (*DIRECT, BEHIND[2])
            for seed in range(first, first + (runs or 10))
        ],
        {name: total(name) for name in ("hours", "faults", "written")},
    ),
    "soak": Case(
        lambda runs, first: [Flight("full load, seconds", BEHIND[2].name, partial(soak, runs or 1200), first)],
        {name: largest(name) for name in ("board_sent", "daemon_sent", "sticks", "cpu_percent")}, longest=36000.0,
    ),
}  # fmt: skip

main: Final = command(
    "stories",
    CASES,
    """Run the safety stories and measure them; exit code 1 if a limit is broken.

    The soak runs processes in real time for twenty minutes, the others run in virtual time. All of them take hours:
    `--case` runs one, `--runs` shortens it.
    """,
)
