"""`python -m lab teleop`: hands lost in flight, in virtual time, and a stick's way to the line, in real time."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from lab.cases import Case, Flight, command, largest, sessions, total
from lab.rigs.cockpit import Boards
from lab.teleop.losses import Way, lose_hands

GENERATIONS: Final = (Boards("early"), Boards("2.08"), Boards("2.12a"))
"""One FlightCtrl of each dead-man generation."""
SESSION: Final = 10
"""Losses between two discoveries of the boards."""


def _losses(way: Way, runs: int | None, first: int) -> list[Flight]:
    return [
        Flight(f"hands lost: {way}", boards.name, partial(lose_hands, boards, way, size), seed)
        for boards in GENERATIONS
        for seed, size in enumerate(sessions(runs or 50, SESSION), first)
    ]


def _latency(moves: int, seed: int) -> Any:
    from lab.teleop.latency import measure_latency  # wants evdev, which not every machine has

    return measure_latency(moves, seed)


CASES: Final = {
    **{
        way.value: Case(
            partial(_losses, way),
            {
                "wire": largest("wire"),
                "released": largest("released"),
                "relapses": total("relapses"),
                "foreign": total("foreign"),
            },
        )
        for way in Way
    },
    "latency": Case(
        lambda runs, first: [Flight("a stick moves", "FC 2.12a", partial(_latency, runs or 1000), first)],
        {name: largest(name) for name in ("p50_ms", "p99_ms", "max_ms", "unseen", "rate")},
        longest=3600.0,
    ),
}

main: Final = command(
    "teleop",
    CASES,
    """Lose pads, terminals and programs in flight, and time a stick; exit code 1 if a limit is broken.

    The losses run in virtual time and are the same on every machine, some five minutes of processor time. `latency`
    runs processes in real time for two minutes: leave the machine alone.
    """,
)
