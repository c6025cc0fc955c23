"""Flights with faults drawn at random: `python -m lab control --case faults`."""

from __future__ import annotations

import json
import math
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from enum import StrEnum
from multiprocessing import get_context
from typing import Any, Final

from lab.control.expectations import TOLERANCE, Expectation
from lab.control.faultrig import LAND_AT, FaultRig
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
TELL_EVERY: Final = 20.0
"""Progress is written at most this often [s]."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """A fault of a flight.

    Attributes:
        name: of the fault.
        at: when it begins [s].
        expected: what may follow.
    """

    name: str
    at: float
    expected: Expectation


class End(StrEnum):
    """How a flight ended."""

    LANDED = "landed"
    """On the target, by its own decision and by the physics."""
    RELEASED = "released"
    """Given to the pilot, for a reason that the table names, in its time."""
    HELD = "held"
    """In the air, under control, when the time was over: an aborted landing, or one that waits."""
    LOST = "lost"
    """Crashed, or out of the volume, under the core's control."""
    WRONG = "wrong"
    """Anything else: a release that no fault explains, one that came too late or not at all."""


def draw(rig: FaultRig, seed: int) -> tuple[Drawn, ...]:
    """Draw one to three faults of a flight."""
    rng = random.Random(f"{seed} faults")
    names = rng.sample(sorted(FAULTS), rng.choice((1, 1, 2, 2, 3)))
    drawn = []
    for name in names:
        at = rng.uniform(FIRST_FAULT, LAST_FAULT)
        drawn.append(Drawn(name, at, FAULTS[name](rig, at, rng)))
    return tuple(sorted(drawn, key=lambda fault: fault.at))


@dataclass(frozen=True, slots=True)
class FaultFlight:
    """What became of one flight.

    Attributes:
        seed: of it.
        faults: names.
        end: how it ended.
        why: reason of the release, or what is wrong.
        frames: stick frames that were checked.
        violations: rules they broke.
    """

    seed: int
    faults: tuple[str, ...]
    end: End
    why: str
    frames: int
    violations: dict[str, int]


def fly_one(seed: int) -> FaultFlight:
    """Fly one flight with faults."""
    wind = random.Random(f"{seed} air").choice((WindClass.INDOOR, WindClass.LIGHT))
    rig = FaultRig(Flight(seed=seed, seconds=LENGTH, wind=wind, land_at=LAND_AT))
    drawn: list[Drawn] = []
    outcome = rig.fly_with(lambda flying: drawn.extend(draw(flying, seed)))
    end, why = judge(rig, tuple(drawn))
    names = tuple(fault.name for fault in drawn)
    return FaultFlight(seed, names, end, why, outcome.frames, dict(outcome.violations))


def judge(rig: FaultRig, drawn: tuple[Drawn, ...]) -> tuple[End, str]:
    """How a flight ended, and why."""
    outcome, record = rig.outcome, rig.record
    if not outcome.engaged:
        return End.WRONG, "it never began"
    released, reason = outcome.released, outcome.reason
    for fault in drawn:
        latest = fault.at + fault.expected.within * TOLERANCE + REACTION
        begun, until = rig.trouble.core_stalled
        if begun <= latest:  # a daemon that stands still notices nothing
            latest = max(latest, until + REACTION)
        if math.isfinite(fault.expected.within) and min(released, _ended(record)) > latest:
            return End.WRONG, f"{fault.name}: no release until {latest - fault.at:.2f} s after it"
    says_down = reason.startswith(("landed on", "came down"))
    if says_down and not outcome.stood:
        return End.WRONG, f"in the air: {reason}"
    if reason.startswith("landed on"):
        is_there = outcome.aside <= ON_TARGET
        return (End.LANDED, reason) if is_there else (End.WRONG, f"{outcome.aside:.2f} m aside: {reason}")
    if math.isfinite(released):
        known = [text for fault in drawn if fault.at <= released for text in fault.expected.reasons]
        # A client whose new manoeuvre is refused has nothing left that flies.
        words = f"{reason}; {outcome.refused}" if reason.startswith("no setpoint from") else reason
        is_known = any(text in words for text in known) or says_down
        return (End.RELEASED, reason) if is_known else (End.WRONG, f"no fault explains: {reason}")
    return (End.LOST, record.lost) if record.lost else (End.HELD, rig.core.phase.value)


def _ended(record: Record) -> float:
    """When the flight was over for another reason [s]; infinite where it was not."""
    return record.times[-1] if record.lost and record.times else math.inf


def run_faults(count: int | None, first_seed: int, jobs: int) -> dict[str, dict[str, Any]]:
    """Fly the campaign; figures by key, every outcome counted; a line of JSON on stderr for each flight that is wrong.

    Args:
        count: flights; the campaign's own number if None.
        first_seed: seeds count up from here.
        jobs: processes.
    """
    count = count or FLIGHTS
    flights: list[FaultFlight] = []
    began = told = time.monotonic()
    with ProcessPoolExecutor(min(jobs, count), get_context("spawn")) as pool:
        for flight in pool.map(fly_one, range(first_seed, first_seed + count), chunksize=4):
            flights.append(flight)
            if flight.end in (End.WRONG, End.LOST) or flight.violations:
                print(json.dumps(asdict(flight)), file=sys.stderr, flush=True)
            if time.monotonic() - told > TELL_EVERY:
                told = time.monotonic()
                print(f"faults: {len(flights)} of {count} flights", file=sys.stderr, flush=True)
    return sum_up(flights, (time.monotonic() - began) * min(jobs, count) / count)


def sum_up(flights: Sequence[FaultFlight], cost: float) -> dict[str, dict[str, Any]]:
    """Figures of the campaign.

    Args:
        flights: all of them.
        cost: processor time of a flight, waiting for other programs included [s].
    """
    ends = Counter(flight.end for flight in flights)
    violations = Counter[str]()
    for flight in flights:
        violations.update(flight.violations)
    count = len(flights)
    return {
        "faults_ends": {end.value: ends[end] for end in End}
        | {"count": count, "goal": "no flight lost or wrong", "holds": not ends[End.WRONG] and not ends[End.LOST]},
        "faults_frames": {
            "checked": sum(flight.frames for flight in flights),
            "violations": dict(violations),
            "count": count,
            "goal": "none",
            "holds": not violations,
        },
        "faults_drawn": dict(Counter(name for flight in flights for name in flight.faults)) | {"holds": True},
        "faults_reasons": dict(Counter(_kind(flight.why) for flight in flights)) | {"holds": True},
        "faults_cost_s": {"mean": round(cost, 2), "holds": True},
    }


def _kind(why: str) -> str:
    """A reason without its numbers."""
    return re.sub(r"[0-9.]+", "#", why)
