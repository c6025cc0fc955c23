"""`python -m lab stories`: the safety stories about link and release, run a thousand times against simulated boards.

In virtual time, seeded, the same on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

from lab.cases import Case, Flight, command, largest, part, sessions, total
from lab.rigs.cockpit import Boards
from lab.stories.deaths import SESSION, fly_session
from lab.stories.hands import HANDS, Way, lose_hands
from lab.stories.standstills import Stopped, stand_still

DIRECT: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"))
"""One FlightCtrl of each dead-man generation."""
BEHIND: Final = (Boards("early", "0.24"), Boards("2.08", "0.24"), Boards("2.12a", "0.24"), Boards("2.14", "2.14"))
"""The same behind a NaviCtrl that passes stick frames on, and the newest pair."""
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
                  "relapses": total("relapses"), "guard_wrote": total("guard_wrote")}
    ),
    "hands": Case(
        _hands, {"wire": largest("wire"), "released": largest("released"), "relapses": total("relapses"),
                 "foreign": total("foreign")}
    ),
    "freeze": Case(_freezes, {"tilted": total("tilted"), "cleared": largest("cleared")}),
}  # fmt: skip

main: Final = command(
    "stories",
    CASES,
    """Run the safety stories and measure them; exit code 1 if a limit is broken.

    All of them take hours: `--case` runs one, `--runs` shortens it.
    """,
)
