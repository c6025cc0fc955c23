"""Flights by motion capture alone, and with its faults, in virtual time: `python -m lab positions`.

What became of a flight is read from the physics. A fault has to be named: by the state of the source, or by what a
take-off waits for. Poses of a faulty source may be used until the boards can contradict it, and never after.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from itertools import product
from typing import Final

from lab.campaign import Campaign, Ending, First, Jobs, Kept, Row, summed_up
from lab.rigs.positionflight import BACK_FROM, HOLD_FROM, LAND_AT, STEP_FROM, PositionFlight
from lab.tables import show
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
    first: First = 1,
    faults: int = 2,
    jobs: Jobs = 2,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Fly by motion capture with many seeds, then with each of its faults; ten seconds of processor time a flight.

    Args:
        seeds: flights in indoor air, and as many in light wind.
        faults: flights of each fault from the ground on, and as many in which it begins in the hold.
    """
    every = [Flight(seed, wind) for wind in ("indoor", "light") for seed in range(first, first + seeds)]
    every += [
        Flight(seed, "light", fault, at)
        for fault, at, seed in product(FAULTS, (0.0, IN_FLIGHT), range(first, first + faults))
        if at or fault not in ALONE_UNSEEN
    ]
    rows = FLIGHTS.rows(every, jobs, results)
    found = []
    for wind in ("indoor", "light"):
        good = [row for row in rows if (row["wind"], row["fault"]) == (wind, "")]
        goals = {"hold_cm": (0.5, GOAL_HOLD_CM)} if wind == "indoor" else {}
        found.append({"what": f"{wind} wind"} | summed_up(good, "hold_cm", "step_cm", "touch_cm", **goals))
    for fault in FAULTS:
        played = [row for row in rows if row["fault"] == fault]
        found.append({"what": fault} | summed_up(played, "named", "farthest"))
    return show([row for row in found if row["flights"]], ("what", "flights"), as_json=as_json)
