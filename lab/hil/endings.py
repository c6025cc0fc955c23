"""`python -m lab hil --case flights`: many flights, how each ended, and what became of every frame.

Take-off, hold, a step of 1 m, light wind, landing; by cable or by the radio with a chosen loss, from a level or a
tilted pad. Physics and the firmware's memory judge: where the aircraft stands, whether its motors turn, and which
frames its receive buffer took.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np
from pydantic import BaseModel

from lab import tables
from lab.campaign import Ending, Row, endings
from lab.hil.aircraft import GenuineAircraft
from lab.hil.flights import ON_TARGET, Array, Leg, SceneFlight, Setting, aircraft_of, config_of, motors_run
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.telemetry.traffic import RawFrame
from mkdaemon.virtualtime import run_virtually
from mksim.config import SimConfig, WindClass
from mksim.programs.rehearsal import FlightPart, FlyingAircraft, land, over_pad, take_off

PARTS: Final = (
    take_off(),
    over_pad("hold", 0.0, 8.0),
    over_pad("aside", -0.5),
    over_pad("step", 0.5, 4.0),
    over_pad("light", 0.0, 6.0, wind=WindClass.LIGHT),
    land(),
)
LIFTED: Final = 0.4
"""An aircraft whose centre of gravity was higher than this above the target has taken off [m]."""
COUNTED: Final = {
    ("raw/tx", "b"): "sticks_sent",
    ("memory", "b"): "sticks_in_memory",
    ("obeyed", "b"): "sticks_obeyed",
    ("raw/tx", "v"): "link_tests_sent",
    ("memory", "v"): "link_tests_in_memory",
    ("raw/rx", "V"): "link_tests_answered",
}
"""Frames written by the daemon, taken by the firmware's receive buffer, held by its external control once they were
handled, and answered."""


class EndFlight(SceneFlight):
    """Flies `PARTS`, and counts frames from the take-off on.

    Attributes:
        let_go_at: when the daemon had ended the flight [s]; infinite before.
        counts: see `COUNTED`.
        waits: how long each frame stayed in the receive buffer [s].
    """

    def __init__(self, config: SimConfig, aircraft: FlyingAircraft) -> None:
        """Set everything up; needs a running loop."""
        super().__init__(config, aircraft, (Leg(PARTS),))
        self.let_go_at, self._is_counting = math.inf, False
        self.counts, self.waits = Counter[str](), list[float]()
        self._memory = aircraft.world if isinstance(aircraft, GenuineAircraft) else None
        if self._memory is not None:
            self._memory.chip.watch_frames()

    async def _follow(self, parts: Sequence[FlightPart]) -> bool:
        self._is_counting = True
        goes_on = await super()._follow(parts)
        self._is_counting = False
        self.let_go_at = self._loop.time()
        return goes_on

    def _count(self, place: str, letter: str) -> None:
        if self._is_counting and (place, letter) in COUNTED:
            self.counts[COUNTED[place, letter]] += 1

    def _value_published(self, suffix: str, value: BaseModel) -> None:
        super()._value_published(suffix, value)
        if isinstance(value, RawFrame) and value.dropped is None:
            self._count(suffix, chr(value.raw[2]))

    def _watch_truth(self, now: float) -> None:
        super()._watch_truth(now)
        if self._memory is None:
            return
        for taken in self._memory.chip.taken():
            for found in FrameDecoder().feed(bytes(taken.frame[: taken.length])):
                if isinstance(found, Frame) and self._is_counting:
                    self.waits.append(taken.done - taken.at)
                    self._count("memory", found.id)
                    held = bytes(taken.held[: self._memory.control_size])
                    self._count("obeyed" if held == found.payload[: len(held)] else "", found.id)


def fly(setting: Setting) -> Row:
    """Fly once in virtual time: how it ended by the physics and the board's motors, and what became of the frames.

    The daemon's reason is only reported.
    """

    async def found() -> Row:
        config = config_of(setting)
        aircraft = aircraft_of(setting, config)
        flight = EndFlight(config, aircraft)
        await flight.fly()
        flown, is_turning = flight.flown, motors_run(aircraft)
        row = {"why": flown.end, "warnings": flight.found["warnings"], **flight.counts}
        if flight.waits:
            row["buffer_held_ms"] = [1000 * float(part) for part in np.percentile(flight.waits, (50, 99, 100))]
        return row | judged(flown.rows(), flight.let_go_at, flown.crashed, motors_run=is_turning)

    return run_virtually(found())


def judged(truth: Array, let_go_at: float, crashed: str, *, motors_run: bool) -> Row:
    """How a flight ended that the daemon let go of at a time [s]; `REFUSED` never rose."""
    if crashed:
        return {"ending": Ending.LOST, "why": crashed}
    if not len(truth) or truth[:, 3].max() < LIFTED:
        return {"ending": Ending.REFUSED}
    row = truth[truth[:, 0] <= let_go_at][-1]
    if not row[4]:
        return {"ending": Ending.RELEASED}
    off = math.hypot(row[1], row[2])
    if off > ON_TARGET or motors_run:
        why = f"{100 * off:.0f} cm from the middle, motors {'on' if motors_run else 'off'}"
        return {"ending": Ending.LOST, "why": why}
    return {"ending": Ending.FINISHED, "off_cm": 100 * off}


def show(rows: Sequence[Row], *, as_json: bool) -> int:
    """Print how flights of every board and line ended, and the sums of the counts; exit code 1 unless all are right."""
    shown = []
    for board, line in dict.fromkeys((row["board"], row["line"]) for row in rows):
        part = [row for row in rows if (row["board"], row["line"]) == (board, line)]
        names = [name for name in COUNTED.values() if any(name in row for row in part)]
        warnings = Counter(text for row in part for text in row.get("warnings", ())).most_common(5)
        shown.append(
            {"board": board, "line": line, **endings(part), "warnings": dict(warnings)}
            | {name: sum(row.get(name, 0) for row in part) for name in names}
            | {"holds": all(row["ending"] in {Ending.FINISHED, Ending.REFUSED} for row in part)}
        )
    return tables.show(shown, ("board", "line"), as_json=as_json)
