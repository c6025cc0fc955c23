"""Flights through a room of surveyed tags, from pad to pad, in virtual time: `python -m lab room`.

The flight is the one of `mkdaemon demo --room`: take-off from one pad, 6 m over 24 tags to the other, half the way
back, a hold and a figure of eight in the middle of the room, landing. What became of it is read from the physics.
"""

from __future__ import annotations

import json
import logging
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import structlog

from lab.campaign import Campaign, Ending, Row, carried_out, endings
from lab.demo import landing_of
from mkdaemon.cli.arguments import AsJson
from mkdaemon.telemetry.control import ControlStatus
from mkdaemon.virtualtime import run_virtually
from mksim.programs.rehearsal import room_demonstration, simulated_aircraft
from mksim.scene.room import AWAY

STRAYED: Final = AWAY + 3.0
"""An aircraft farther from the pad than this is lost [m]."""
GOAL_P90_CM: Final = 6.0
"""Goal for the distance of landings from the middle of the pad, 90 of 100."""


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight.

    Attributes:
        seed: of everything random, and of what the survey left wrong.
        wind: none, indoor, light or moderate.
        fps: images a second.
    """

    seed: int
    wind: str
    fps: float


def fly(flight: Flight) -> Row:
    """Fly once.

    Returns:
        How it ended and why; `touch_cm` from the middle of the pad at the end; `hold_cm` and `midway_cm`, horizontal
        RMS of the true place against the wanted one over the pad and in the middle of the room; `eight_cm`, the same
        along the figure of eight; `posed`, share of the images with a pose; its length [s].
    """
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    reasons: list[str] = []

    def watch(_: object, status: ControlStatus | None) -> None:
        if status is not None and status.phase.value == "releasing" and not reasons:
            reasons.append(status.reason)

    async def flown() -> Any:
        rehearsal = room_demonstration(simulated_aircraft(flight.seed, flight.wind, flight.fps), watch)
        record = await rehearsal.fly()
        return record, rehearsal.world.truth.on_ground

    record, stands = run_virtually(flown(), 0.0)
    farthest = max((math.hypot(*moment.position[:2]) for moment in record.moments), default=0.0)
    return landing_of(record, "".join(reasons), stands=stands, is_lost=farthest > STRAYED) | {
        "hold_cm": _rms_cm(record.errors("hold")),
        "midway_cm": _rms_cm(record.errors("midway")),
        "eight_cm": _rms_cm(record.errors("eight")),
        "posed": round(record.posed / max(record.images, 1), 3),
    }


def _rms_cm(errors: Any) -> float | None:
    return round(100.0 * float(np.sqrt((errors[:, :2] ** 2).sum(axis=1).mean())), 1) if len(errors) else None


ROOMS: Final = Campaign("room", fly, asdict, limit=900.0)


def main(
    *,
    seeds: int = 20,
    first: int = 1,
    wind: str = "light",
    fps: float = 15.0,
    jobs: int = 2,
    results: Path | None = None,
    as_json: AsJson = False,
) -> int:
    """Fly from pad to pad with many seeds; half a minute of processor time a flight.

    Args:
        seeds: flights.
        first: seed.
        wind: none, indoor, light or moderate.
        fps: images a second.
        jobs: processes.
        results: file of rows, one JSON object a line; a run that was interrupted goes on with it.
    """
    rows = ROOMS.rows([Flight(seed, wind, fps) for seed in range(first, first + seeds)], jobs, results)
    found: dict[str, Any] = endings(rows)
    for name in ("touch_cm", "hold_cm", "midway_cm", "eight_cm", "posed"):
        values = [row[name] for row in carried_out(rows) if row[name] is not None]
        found[name] = {str(q): round(float(np.quantile(values, q)), 2) for q in (0.5, 0.9, 1.0)} if values else {}
    if as_json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:<12} {value}")
    is_near = found["touch_cm"].get("0.9", math.inf) <= GOAL_P90_CM
    return 0 if is_near and all(row["ending"] == Ending.FINISHED for row in rows) else 1
