"""`python -m lab stories`: the safety stories about link and release, run a thousand times against simulated boards.

Everything in virtual time is seeded and the same on every machine; `plug`, `kill` and `soak` run processes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from lab.campaign import Row
from lab.cases import Case, Flight, command, largest, part, sessions, total
from lab.rigs.cockpit import Boards
from lab.stories.cable import pull_cable
from lab.stories.deaths import SESSION, SilentRelease, fly_session
from lab.stories.faults import FAULTS, judge_fault
from lab.stories.kill import SIGNALS, end_daemon
from lab.stories.plug import replug
from lab.stories.restarts import restart
from lab.stories.soak import soak
from lab.stories.standstills import Stopped, stand_still
from lab.stories.swaps import swap_aircraft

DIRECT: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"))
"""One FlightCtrl of each dead-man generation."""
BEHIND: Final = (Boards("early", "0.24"), Boards("2.08", "0.24"), Boards("2.12a", "0.24"), Boards("2.14", "2.14"))
"""The same behind a NaviCtrl that passes stick frames on, and the newest pair."""
UNRELEASED_WATCH: Final = 8.0
"""Longer than every dead-man [s]."""
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


def _unreleased(runs: int | None, first: int) -> Flights:
    fly = partial(fly_session, link_class=SilentRelease, watched=UNRELEASED_WATCH)
    return [
        Flight("counter-proof: no active release", boards.name, partial(fly, boards, deaths=size), seed)
        for boards in DIRECT
        for seed, size in enumerate(sessions(runs or 100, SESSION), first)
    ]


def _fails(boards: str, found: Sequence[Row]) -> bool:
    """Whether every death breaks the limits; 2.12 drops sticks by itself, late, whatever else is asked."""
    return all(one["is_wrong"] and ("2.12" in boards or one["released"] is None) for one in found)


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


def _one(what: str, boards: str, fly: Callable[..., Any], default: int) -> Callable[[int | None, int], Flights]:
    """A flight whose first argument is how much is asked for."""
    return lambda runs, first: [Flight(what, boards, partial(fly, runs or default), first)]


CASES: Final = {
    "deaths": Case(
        _deaths, {"wire_p999": part("wire", 0.999), "wire": largest("wire"), "released": largest("released"),
                  "relapses": total("relapses")}
    ),
    "unreleased": Case(_unreleased, {"released": largest("released")}, holds=_fails),
    "cable": Case(_cuts, {"back": largest("back"), "steered": total("steered"), "obeyed": largest("obeyed")}),
    "swap": Case(
        _one("another aircraft at the same port", "FC 2.12a and 2.08 behind NC 0.24", swap_aircraft, RUNS),
        {"wrong_layout": total("wrong"), "right_layout": total("right")},
    ),
    "freeze": Case(_freezes, {"tilted": total("tilted"), "cleared": largest("cleared")}),
    "restart": Case(
        lambda runs, first: [
            Flight("daemon killed and started in flight", boards.name,
                   partial(restart, boards, count=runs or RUNS), first)
            for boards in BEHIND
        ],
        {"cleared": largest("cleared"), "steered": total("steered")},
    ),
    "plug": Case(
        _one("unplugged and plugged in, a pseudo terminal", "FC 2.12a behind NC 0.24", replug, 200),
        {"back_p50": largest("back_p50"), "back": largest("back_max")}, longest=3600.0,
    ),
    "kill": Case(
        lambda runs, first: [
            Flight(f"daemon gets {number.name}", boards.name, partial(end_daemon, boards.fc, number), first - 1 + run)
            for number in SIGNALS
            for boards in DIRECT
            for run in range(runs or 5)
        ],
        {**{name: largest(name) for name in ("took", "held", "released")}, "steered": total("steered")},
    ),
    "faults": Case(
        lambda runs, first: [
            Flight(f"line fault: {fault.value}", boards.name, partial(judge_fault, boards, fault), first - 1 + run)
            for boards in (DIRECT[2], BEHIND[2])
            for fault in FAULTS
            for run in range(runs or 20)
        ],
        {"verdict": largest("verdict"), "back": largest("back")},
    ),
    "soak": Case(
        _one("full load; a run is a second", "FC 2.12a behind NC 0.24", soak, 1200),
        {name: largest(name) for name in ("board_sent", "daemon_sent", "sticks", "cpu_percent")}, longest=36000.0,
    ),
}  # fmt: skip

main: Final = command(
    "stories",
    CASES,
    """Run the safety stories and measure them; exit code 1 if a limit is broken.

    Plug, kill and soak run processes in real time, the others run in virtual time; the soak alone takes
    twenty minutes. All of them take hours: `--case` runs one, `--runs` shortens it.
    """,
)
