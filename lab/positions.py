"""Flights by motion capture alone, and with its faults, in virtual time: `python -m lab positions`.

What became of a flight is read from the physics. A fault has to be named: by the state of the source, or by what a
take-off waits for. Poses of a faulty source may be used until the boards can contradict it, and never after.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from lab.campaign import Campaign, Ending, Row, carried_out, endings
from lab.rigs.positionflight import BACK_FROM, HOLD_FROM, LAND_AT, STEP_FROM, PositionFlight
from mkdaemon.cli.arguments import AsJson
from mksim.config import WindClass
from mksim.physics.mocap import FAULTS

GOAL_HOLD_CM: Final = 2.2
"""Goal for the horizontal RMS of a hold."""
VOLUME: Final = 3.0
"""An aircraft farther from the middle of the pad than this is out of the volume [m]."""
SETTLING: Final = 3.0
"""Time after the beginning of a hold that does not count [s]."""
IN_FLIGHT: Final = 19.0
"""A fault that does not begin on the ground begins then, in the hold [s]."""
ALONE_UNSEEN: Final = ("off",)
"""On the ground no source alone shows these: a frame that is off moves the place, and nothing else."""


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight.

    Attributes:
        seed: of everything random.
        wind: none, indoor, light or moderate.
        fault: of the motion capture system; empty for none.
        at: when it begins [s].
    """

    seed: int
    wind: str
    fault: str = ""
    at: float = 0.0


def fly(flight: Flight) -> Row:
    """Fly once; its ending, and `hold_cm`, `step_cm`, `touch_cm`, or `named` after [s] and `farthest` [m]."""
    rig = PositionFlight(flight.seed, WindClass(flight.wind), flight.fault, flight.at)
    record, truth = rig.fly(), rig.world_truth
    farthest = max((math.hypot(*place[:2]) for place in record.positions), default=0.0)
    why = record.lost or truth.crash_reason or (f"{farthest:.1f} m away" if farthest > VOLUME else "")
    row: Row = {"ending": Ending.LOST if why else Ending.FINISHED, "why": why, "farthest": farthest}
    if not flight.fault:
        row |= {
            "hold_cm": 100.0 * rig.hold_rms(HOLD_FROM + SETTLING, STEP_FROM),
            "step_cm": 100.0 * rig.hold_rms(STEP_FROM + SETTLING, BACK_FROM),
            "touch_cm": 100.0 * record.touch_error,
        }
        is_down = record.touched > LAND_AT and record.stands and not rig.named
        return row if why or is_down else row | {"ending": Ending.WRONG, "why": "no landing, or named without a fault"}
    named = next((at for at, *_ in rig.named), math.inf) - flight.at
    words = rig.named[0][2] if rig.named else rig.waited_for
    late = [at for at in rig.used if at > flight.at + named + 0.2]
    if not why and (not words or late):
        row |= {"ending": Ending.WRONG, "why": f"{'used after it was named' if words else 'not named'}"}
    return row | {"named": named, "words": words, "released": rig.released[0][1] if rig.released else ""}


FLIGHTS: Final = Campaign("positions", fly, asdict, limit=300.0)


def main(
    *,
    seeds: int = 10,
    first: int = 1,
    faults: int = 2,
    jobs: int = 2,
    results: Path | None = None,
    as_json: AsJson = False,
) -> int:
    """Fly by motion capture with many seeds, then with each of its faults; ten seconds of processor time a flight.

    Args:
        seeds: flights in indoor air, and as many in light wind.
        first: seed.
        faults: flights of each fault from the ground on, and as many in which it begins in the hold.
        jobs: processes.
        results: file of rows, one JSON object a line; a run that was interrupted goes on with it.
    """
    every = [Flight(seed, wind) for wind in ("indoor", "light") for seed in range(first, first + seeds)]
    every += [
        Flight(seed, "light", fault, at)
        for fault, at, seed in product(FAULTS, (0.0, IN_FLIGHT), range(first, first + faults))
        if at or fault not in ALONE_UNSEEN
    ]
    rows = FLIGHTS.rows(every, jobs, results)
    found: dict[str, Any] = endings(rows)
    good = [row for row in carried_out(rows) if "hold_cm" in row]
    for wind, name in product(("indoor", "light"), ("hold_cm", "step_cm", "touch_cm")):
        values = [row[name] for row in good if row["wind"] == wind]
        if values:
            found[f"{name} {wind}"] = {str(q): round(float(np.quantile(values, q)), 2) for q in (0.5, 0.9, 1.0)}
    for fault in FAULTS:
        played = [row for row in carried_out(rows) if row["fault"] == fault]
        latest, farthest = (max((row[key] for row in played), default=0.0) for key in ("named", "farthest"))
        found[fault] = f"{len(played)} flights, named {latest:.1f} s after, {farthest:.1f} m away at most"
    print(json.dumps(found) if as_json else "\n".join(f"{name:<16} {value}" for name, value in found.items()))
    held = found.get("hold_cm indoor", {}).get("0.5", math.inf)
    return 0 if held <= GOAL_HOLD_CM and all(row["ending"] == Ending.FINISHED for row in rows) else 1
