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

from lab import tables
from lab.campaign import Ending, Row, endings
from lab.hil.aircraft import GenuineAircraft
from lab.hil.flights import ON_TARGET, Array, Leg, SceneFlight, Setting, aircraft_of, config_of, motors_run
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.virtualtime import run_virtually
from mksim.config import SimConfig, WindClass
from mksim.physics.world import World
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
LETTERS: Final = {"b": "sticks", "v": "link_tests"}
"""Frames that are counted."""


class Tap:
    """The aircraft, and every stick frame and link test that crosses its line while `is_counting`.

    Attributes:
        aircraft: behind it.
        now: simulated time [s].
        is_counting: frames count from here on.
        counts: frames written by the daemon (`sticks_sent`), taken by the firmware's receive buffer
            (`sticks_in_memory`), held by its external control once they were handled (`sticks_obeyed`), and of link
            tests `link_tests_sent`, `link_tests_in_memory` and `link_tests_answered`.
        waits: how long each frame stayed in the receive buffer [s].
    """

    def __init__(self, aircraft: FlyingAircraft) -> None:
        self.aircraft, self.now, self.is_counting = aircraft, aircraft.now, False
        self.counts, self.waits = Counter[str](), list[float]()
        self._out, self._in = FrameDecoder(), FrameDecoder()
        if isinstance(aircraft, GenuineAircraft):
            aircraft.world.chip.watch_frames()

    @property
    def world(self) -> World:
        """Airframe, air, pilot and faults."""
        return self.aircraft.world

    def write(self, data: bytes, at: float) -> None:
        """Bytes of the daemon."""
        self._count(self._out, data, "sent")
        self.aircraft.write(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run on; see `FlyingAircraft`."""
        answers = self.aircraft.advance(to)
        self.now = to
        self._count(self._in, b"".join(data for _, data in answers), "answered")
        if isinstance(self.aircraft, GenuineAircraft):
            self._look_into_memory(self.aircraft)
        return answers

    def _count(self, decoder: FrameDecoder, data: bytes, end: str) -> list[Frame]:
        """Count the frames in some bytes, and return them."""
        frames = [found for found in decoder.feed(data) if isinstance(found, Frame)]
        for frame in frames if self.is_counting else ():
            letter = frame.id.lower() if end == "answered" else frame.id
            if letter in LETTERS and (end, letter) != ("answered", "b"):
                self.counts[f"{LETTERS[letter]}_{end}"] += 1
        return frames

    def _look_into_memory(self, aircraft: GenuineAircraft) -> None:
        size = aircraft.world.control_size
        for taken in aircraft.world.chip.taken():
            frames = self._count(FrameDecoder(), bytes(taken.frame[: taken.length]), "in_memory")
            if frames and self.is_counting:
                self.waits.append(taken.done - taken.at)
                is_held = bytes(taken.held[:size]) == frames[0].payload[:size]
                self.counts["sticks_obeyed"] += frames[0].id == "b" and is_held


class EndFlight(SceneFlight):
    """Flies `PARTS`; its tap counts from the take-off on.

    Attributes:
        let_go_at: when the daemon had ended the flight [s]; infinite before.
    """

    def __init__(self, config: SimConfig, tap: Tap) -> None:
        """Set everything up; needs a running loop."""
        super().__init__(config, tap, (Leg(PARTS),))
        self._tap, self._aircraft = tap, tap.aircraft
        self.let_go_at = math.inf

    async def _follow(self, parts: Sequence[FlightPart]) -> bool:
        self._tap.is_counting = True
        goes_on = await super()._follow(parts)
        self._tap.is_counting = False
        self.let_go_at = self._loop.time()
        return goes_on


def fly(setting: Setting) -> Row:
    """Fly once in virtual time: how it ended by the physics and the board's motors, and what became of the frames.

    The daemon's reason is only reported.
    """

    async def found() -> Row:
        config = config_of(setting)
        tap = Tap(aircraft_of(setting, config))
        flight = EndFlight(config, tap)
        await flight.fly()
        flown, is_turning = flight.flown, motors_run(tap.aircraft)
        row = {"why": flown.end, "warnings": flight.found["warnings"], **tap.counts}
        if tap.waits:
            row["buffer_held_ms"] = [1000 * float(part) for part in np.percentile(tap.waits, (50, 99, 100))]
        return row | judged(flown.rows(), flight.let_go_at, flown.crashed, motors_run=is_turning)

    return run_virtually(found())


def judged(truth: Array, let_go_at: float, crashed: str, *, motors_run: bool) -> Row:
    """How a flight ended: `FINISHED` stands on the target, motors off; `REFUSED` never left the ground.

    Args:
        truth: see `Flown.truth`.
        let_go_at: when the daemon had ended the flight [s].
        crashed: why the aircraft broke; empty while whole.
        motors_run: whether the board turns the motors at the end.
    """
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
        names = dict.fromkeys(name for row in part for name in row if name.startswith(tuple(LETTERS.values())))
        warnings = Counter(text for row in part for text in row.get("warnings", ())).most_common(5)
        shown.append(
            {"board": board, "line": line, **endings(part), "warnings": dict(warnings)}
            | {name: sum(row.get(name, 0) for row in part) for name in names}
            | {"holds": all(row["ending"] in {Ending.FINISHED, Ending.REFUSED} for row in part)}
        )
    return tables.show(shown, ("board", "line"), as_json=as_json)
