"""Flights through a room of surveyed tags, from pad to pad, in virtual time: `python -m lab room`.

The flight is the one of `mkdaemon demo --room`: take-off from one pad, 6 m over 24 tags to the other, half the way
back, a hold and a figure of eight in the middle of the room, landing. What became of it is read from the physics.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from lab.campaign import Campaign, Ending, First, Jobs, Kept, Row, summed_up
from lab.demo import flown
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mksim.programs.flightrecord import Rehearsed
from mksim.programs.rehearsal import room_demonstration, simulated_aircraft
from mksim.scene.room import AWAY

STRAYED: Final = AWAY + 3.0
"""An aircraft farther from the pad than this is lost [m]."""
GOAL_P90_CM: Final = 6.0
"""Goal for the distance of landings from the middle of the pad, 90 of 100."""


def fly(flight: Row) -> Row:
    """Fly once.

    Args:
        flight: `seed`, of what the survey left wrong, too; `wind` and `fps`.

    Returns:
        How it ended and why; `touch_cm` from the middle of the pad at the end; `hold_cm` and `midway_cm`, horizontal
        RMS of the true place against the wanted one over the pad and in the middle of the room; `eight_cm`, the same
        along the figure of eight; `posed`, share of the images with a pose; its length [s].
    """
    aircraft = simulated_aircraft(flight["seed"], flight["wind"], flight["fps"])
    record, row = flown(lambda watch: room_demonstration(aircraft, watch), STRAYED)
    return judged(row, record)


def judged(row: Row, record: Rehearsed) -> Row:
    """A row with the figures of its record; a landing before every part was flown did not finish."""
    parts = {"hold_cm": "hold", "midway_cm": "midway", "eight_cm": "eight"}
    figures = {name: rms_cm(np.hypot(*record.errors(part)[:, :2].T)) for name, part in parts.items()}
    missing = [part for name, part in parts.items() if figures[name] is None]
    if missing and row["ending"] == Ending.FINISHED:
        row = row | {"ending": Ending.WRONG, "why": f"not flown: {', '.join(missing)}"}
    return row | figures | {"posed": round(record.posed / max(record.images, 1), 3)}


def rms_cm(distances: npt.ArrayLike) -> float | None:
    """Root mean square of distances [m]; None for none."""
    squares = np.square(distances)
    return round(100.0 * float(np.sqrt(squares.mean())), 1) if squares.size else None


ROOMS: Final = Campaign("room", fly, dict, limit=900.0)


def main(
    *,
    seeds: int = 20,
    first: First = 1,
    wind: str = "light",
    fps: float = 15.0,
    jobs: Jobs = 2,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Fly from pad to pad with many seeds; half a minute of processor time a flight.

    Args:
        seeds: flights.
        wind: none, indoor, light or moderate.
        fps: images a second.
    """
    asked = [{"seed": seed, "wind": wind, "fps": fps} for seed in range(first, first + seeds)]
    rows = ROOMS.rows(asked, jobs, results)
    figures = ("touch_cm", "hold_cm", "midway_cm", "eight_cm", "posed")
    return show([summed_up(rows, *figures, touch_cm=(0.9, GOAL_P90_CM))], ("flights",), as_json=as_json)
