"""Flights with faults drawn at random: `python -m lab control --case faults`."""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from lab.campaign import Campaign, Ending, Row, endings
from lab.control.faultrig import LAND_AT, TOLERANCE, Expectation, FaultRig
from lab.control.faults import FAULTS
from lab.control.flights import Flight, Record
from mksim.config import WindClass

LENGTH: Final = 27.0
"""Longest flight [s]."""
FIRST_FAULT: Final = 6.0
"""Faults begin from here on, when the core flies [s]."""
LAST_FAULT: Final = 16.0
"""And not after this, in the middle of the landing [s]."""
REACTION: Final = 0.06
"""Three periods of control [s]: a time is only noticed at a tick."""
FLIGHTS: Final = 1000
"""Flights of the campaign."""
ON_TARGET: Final = 0.35
"""An aircraft that has landed stands no farther from the middle of the target [m]."""


class Drawn(NamedTuple):
    """A fault of a flight: its name, when it begins [s], and what may follow."""

    name: str
    at: float
    expected: Expectation


def draw(rig: FaultRig, seed: int) -> tuple[Drawn, ...]:
    """Draw one to three faults of a flight."""
    rng = random.Random(f"{seed} faults")
    names = rng.sample(sorted(FAULTS), rng.choice((1, 1, 2, 2, 3)))
    drawn = []
    for name in names:
        at = rng.uniform(FIRST_FAULT, LAST_FAULT)
        drawn.append(Drawn(name, at, FAULTS[name](rig, at, rng)))
    return tuple(sorted(drawn, key=lambda fault: fault.at))


def fly_one(seed: int) -> Row:
    """Fly one flight with faults.

    Returns:
        Names of its `faults`; its `ending`: `HELD` is an aborted landing, or one that waits; `why`, reason of the
        release, or what is wrong; `frames`, stick frames that were checked; `violations`, rules they broke.
    """
    wind = random.Random(f"{seed} air").choice((WindClass.INDOOR, WindClass.LIGHT))
    rig = FaultRig(Flight(seed=seed, seconds=LENGTH, wind=wind, land_at=LAND_AT))
    drawn: list[Drawn] = []
    outcome = rig.fly_with(lambda flying: drawn.extend(draw(flying, seed)))
    end, why = judge(rig, tuple(drawn))
    found = {"faults": [fault.name for fault in drawn], "ending": end, "why": why}
    return found | {"frames": outcome.frames, "violations": dict(outcome.violations)}


def judge(rig: FaultRig, drawn: tuple[Drawn, ...]) -> tuple[Ending, str]:
    """How a flight ended, and why."""
    outcome, record = rig.outcome, rig.record
    if not outcome.engaged:
        return Ending.WRONG, "it never began"
    released, reason = outcome.released, outcome.reason
    for fault in drawn:
        latest = fault.at + fault.expected.within * TOLERANCE + REACTION
        begun, until = rig.trouble.core_stalled
        if begun <= latest:  # a daemon that stands still notices nothing
            latest = max(latest, until + REACTION)
        if math.isfinite(fault.expected.within) and min(released, _ended(record)) > latest:
            return Ending.WRONG, f"{fault.name}: no release until {latest - fault.at:.2f} s after it"
    says_down = reason.startswith(("landed on", "came down"))
    if says_down and not outcome.stood:
        return Ending.WRONG, f"in the air: {reason}"
    if reason.startswith("landed on"):
        is_there = outcome.aside <= ON_TARGET
        return (Ending.FINISHED, reason) if is_there else (Ending.WRONG, f"{outcome.aside:.2f} m aside: {reason}")
    if math.isfinite(released):
        known = [text for fault in drawn if fault.at <= released for text in fault.expected.reasons]
        # A client whose new manoeuvre is refused has nothing left that flies.
        words = f"{reason}; {outcome.refused}" if reason.startswith("no setpoint from") else reason
        is_known = any(text in words for text in known) or says_down
        return (Ending.RELEASED, reason) if is_known else (Ending.WRONG, f"no fault explains: {reason}")
    return (Ending.LOST, record.lost) if record.lost else (Ending.HELD, rig.core.phase.value)


def _ended(record: Record) -> float:
    """When the flight was over for another reason [s]; infinite where it was not."""
    return record.times[-1] if record.lost and record.times else math.inf


FAULT_FLIGHTS: Final = Campaign("control faults", fly_one, lambda seed: {"seed": seed}, limit=300.0)


def run_faults(count: int | None, first_seed: int, jobs: int, results: Path | None = None) -> dict[str, Row]:
    """Fly the campaign; its summary."""
    return {"faults": sum_up(FAULT_FLIGHTS.rows(range(first_seed, first_seed + (count or FLIGHTS)), jobs, results))}


def sum_up(rows: Sequence[Row]) -> Row:
    """How all flights ended, how many stick frames were checked, and the rules they broke."""
    ends, violations = endings(rows), Counter[str]()
    for row in rows:
        violations.update(row.get("violations", {}))
    bad = (Ending.WRONG, Ending.LOST, Ending.FAILED)
    return ends | {
        "unfinished": [text for text in ends["unfinished"] if text.split(": ")[1] in bad],
        "frames": sum(row.get("frames", 0) for row in rows),
        "violations": dict(violations),
        "holds": not violations and not any(row["ending"] in bad for row in rows),
    }
