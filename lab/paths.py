"""Figures of eight of 2 x 1 m over surveyed tags, in virtual time: `python -m lab paths`.

The figure is the lemniscate of Gerono, x = sin w t and y = sin(2 w t) / 2, flown at a mean of 1 m/s: 1.46 m/s in the
middle, 2.3 m/s2 in the bends. The limits of speed and acceleration are raised for it. How far the aircraft is from the
path is read from the physics, at the moment for which the daemon says where it should be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from pydantic import BaseModel

from lab.campaign import Campaign, Ending, First, Jobs, Kept, Row, summed_up
from lab.demo import flown
from lab.room import STRAYED, rms_cm
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.telemetry.control import ControlError
from mkdaemon.telemetry.path import PathFlown
from mkdaemon.telemetry.setpoint import LandSetpoint, PathSetpoint, TakeOffSetpoint
from mksim.programs.rehearsal import (
    HEIGHT,
    FlightPart,
    Rehearsal,
    Watcher,
    over_goal,
    room_demonstration,
    simulated_aircraft,
)
from mksim.scene.room import GOAL, figure_of_eight

LAPS: Final = 3
SPEED: Final = 1.0
"""[m/s]."""
LIMITS: Final = {"max_speed": 1.6, "max_acceleration": 2.6}
"""Values of `control.autopilot` for it."""
FULL: Final = 0.99
"""The path is flown at full speed from this rate of its clock on."""
GOAL_RMS_CM: Final = 10.0
"""Goal for the horizontal distance from the path, root mean square."""


def fly(flight: Row) -> Row:
    """Fly once.

    Args:
        flight: `seed`, of what the survey left wrong, too; `wind`; `speed`, mean along the path [m/s].

    Returns:
        How it ended and why; `touch_cm` from the middle of the pad at the end; `rms_cm` and `most_cm`, horizontal
        distance of the true place from the one on the path; `slowed`, share of the time in which its clock was slower
        than planned, beginning and end included.
    """
    followed = Followed()

    def prepare(watch: Watcher) -> Rehearsal:
        aircraft = simulated_aircraft(flight["seed"], flight["wind"], 15.0)
        return followed.attached(room_demonstration(aircraft, watch, None, eights(flight["speed"]), limits=LIMITS))

    _, row = flown(prepare, STRAYED)
    return followed.judged(row)


def eights(speed: float = SPEED) -> tuple[FlightPart, ...]:
    """What is flown, at a mean along the path [m/s]."""
    return (
        FlightPart("take-off", TakeOffSetpoint, {"height": HEIGHT, "target": GOAL}),
        FlightPart("path", PathSetpoint, {"target": GOAL}, path=figure_of_eight(speed, LAPS, HEIGHT)),
        over_goal("return", 0.0, 0.0),
        FlightPart("land", LandSetpoint, {"target": GOAL}),
    )


@dataclass(slots=True)
class Followed:
    """How an aircraft follows a path, seen from outside.

    Attributes:
        away: horizontal distances of the true place from the one on the path [m].
        rates: of the clock of the path.
    """

    away: list[float] = field(default_factory=list)
    rates: list[float] = field(default_factory=list)

    def attached(self, rehearsal: Rehearsal) -> Rehearsal:
        """Follow a flight that has not begun."""

        def take(suffix: str, value: BaseModel) -> None:
            if isinstance(value, PathFlown):
                self.rates.append(value.rate if 0.0 < value.progress < 1.0 else 0.0)
            elif isinstance(value, ControlError) and value.manoeuvre == "path" and self.rates and self.rates[-1] > 0.0:
                self.away.append(math.dist(rehearsal.world.truth.position_enu[:2], value.goal[:2]))

        rehearsal.bus.followers.append(take)
        return rehearsal

    def judged(self, row: Row) -> Row:
        """The row of a flight with its figures; without a path it has not finished what it was flown for."""
        if not self.away:
            unflown = {"ending": Ending.HELD, "why": "no path was flown"} if row["ending"] == Ending.FINISHED else {}
            return row | unflown | {"rms_cm": None, "most_cm": None}
        return row | {
            "rms_cm": rms_cm(self.away),
            "most_cm": round(100.0 * max(self.away), 1),
            "slowed": round(float(np.mean([0.0 < rate < FULL for rate in self.rates])), 3),
        }


PATHS: Final = Campaign("paths", fly, dict, limit=900.0)


def main(
    *,
    seeds: int = 10,
    first: First = 1,
    wind: str = "light",
    speed: float = SPEED,
    jobs: Jobs = 2,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Fly figures of eight with many seeds; half a minute of processor time a flight.

    Args:
        seeds: flights.
        wind: none, indoor, light or moderate.
        speed: mean, along the path [m/s].
    """
    asked = [{"seed": seed, "wind": wind, "speed": speed} for seed in range(first, first + seeds)]
    rows = PATHS.rows(asked, jobs, results)
    figures = summed_up(rows, "rms_cm", "most_cm", "touch_cm", rms_cm=(1.0, GOAL_RMS_CM))
    return show([figures], ("flights",), as_json=as_json)
