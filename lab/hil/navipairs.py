"""`python -m lab hil --case pair`: a genuine FlightCtrl behind a genuine NaviCtrl, the daemon in front of both."""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any, Final

from lab import tables
from lab.campaign import Row
from lab.hil.build import built
from lab.hil.navibuild import built_navictrl
from lab.hil.navidaemon import NEUTRAL, DaemonAtNavi, Step
from lab.hil.naviflight import BOOTED, VOLTAGE, fly_all
from lab.hil.navipair import NaviPair
from lab.hil.quiet import be_quiet
from mkdaemon.virtualtime import run_virtually
from mksim.config import FlightConfig, PilotPlan, SimConfig, WindClass
from mksim.physics.truth import Truth

LOOK: Final = 2.0
SAMPLE: Final = 0.05
TRIES: Final = 3
"""Times that the cable is cut, and that the client falls silent."""
TILTS: Final = 20
"""Setpoints with a tilt before each."""
TILT: Final = 5.0
"""[count]."""
REACHED: Final = "sticks reach the FlightCtrl"
FIGURES: Final = ("take_off_far_cm", "hold_cm", "touch_cm", "sink", "nees_level")
"""Of a flight; see `lab.hil.flights.figures`."""
SLOWEST: Final = 8.0
"""Longest that sticks are waited for to be dropped [s]."""


class PairDaemon(DaemonAtNavi):
    """A daemon at a genuine pair, whose telemetry is compared with what is true."""

    def _note(self, name: str, ended: str, figure: float | None = None) -> None:
        super()._note(name, ended, figure)
        print(f"{self.loop.time():.1f} s: {name}: {ended} {figure}", file=sys.stderr, flush=True)

    async def _ask(self) -> None:
        """Nothing: `--case navictrl` does that."""

    async def _store(self) -> None:
        """Nothing: `--case navictrl` does that."""

    async def _hover(self) -> None:
        await super()._hover()
        world, errors = self.aircraft.world, dict[str, list[float]]()
        for _ in range(round(LOOK / SAMPLE)):
            await asyncio.sleep(SAMPLE)
            for name, value in errors_of(self.bus.values, world.truth, world.pilot.gas).items():
                errors.setdefault(name, []).append(value)
        for name, found in errors.items():
            self._note(f"{name}, off by", "told", median(found))
        self._look(world.truth)

    def _look(self, truth: Truth) -> None:
        flies = not truth.on_ground and not truth.crashed
        self._note("flies at [m]", "yes" if flies else "no", float(truth.position_enu[2]))

    async def _dead_man(self) -> None:
        """The cable is cut, and the client falls silent, in turn, while a tilt is held."""
        for number in range(1, TRIES + 1):
            self._cut(cut=True)
            await self._time(f"cable cut, held for ({number})", lambda: not self._held()[4])
            self._cut(cut=False)
            await self._steer_again(number)
            await self._time(f"client silent, level after ({number})", lambda: self._held()[0] == 0)
            await self._time(f"client silent, let go after ({number})", lambda: not self._held()[4])
            if number < TRIES:
                await self._steer_again(number)
        self._look(self.aircraft.world.truth)

    def _cut(self, *, cut: bool) -> None:
        self._line.is_cut = self._line.is_deaf = cut

    async def _time(self, name: str, claim: Callable[[], bool]) -> None:
        began = self._streamed_at
        took = await self._until(claim, SLOWEST)
        self._note(name, "never" if took is None else "yes", None if took is None else self.loop.time() - began)

    async def _steer_again(self, number: int) -> None:
        """Take the lease once the aircraft is known again, and ask for a tilt."""
        link = self.wiring.link
        took = await self._until(lambda: link.is_up and link.dialect.extern_control is not None, SLOWEST)
        if took is None:
            self._note(f"known again ({number})", "never")
            return
        await asyncio.sleep(LOOK)
        await self.bus.take_lease("lab")
        await self._stream(NEUTRAL, lambda count: 0.0)
        await self._stream(TILTS, lambda count: TILT)


def errors_of(values: Mapping[str, Any], truth: Truth, throttle: int) -> dict[str, float]:
    """How far telemetry is off the truth.

    Args:
        values: newest of every key.
        truth: of the aircraft.
        throttle: the pilot's [stick].
    """
    found = {}
    attitude, pilot, height, place = (
        values.get(f"state/{key}") for key in ("attitude", "pilot", "altitude", "position")
    )
    if attitude is not None:
        off = max(abs(attitude.pitch - truth.pitch), abs(attitude.roll - truth.roll))
        found["pitch and roll [deg]"] = math.degrees(off)
        found["heading [deg]"] = abs(math.degrees(math.remainder(attitude.yaw - truth.yaw, math.tau)))
    if pilot is not None and pilot.throttle_in_use is not None:
        found["throttle [count]"] = abs(pilot.throttle_in_use - throttle)
    if height is not None:
        found["height by the barometer [m]"] = abs(height.above_start - float(truth.position_enu[2]))
    if place is not None and place.position_enu is not None:
        east, north = (
            float(here - there) for here, there in zip(place.position_enu[:2], truth.position_enu, strict=False)
        )
        found["place by GPS [m]"] = math.hypot(east, north)
    return found


def measure(flight: str, seed: int) -> tuple[str, list[Step]]:
    """Let the daemon do everything at a pair; the NaviCtrl's release, and what became of each step.

    Args:
        flight: name of a FlightCtrl that was built.
        seed: of everything random.

    Raises:
        ConfigError: something is not built.
    """
    be_quiet()
    navi = built_navictrl()
    wind = FlightConfig(wind=WindClass.INDOOR)
    config = SimConfig(seed=seed, pilot_plan=PilotPlan.NOTHING, flight=wind)

    async def run() -> list[Step]:
        pair = NaviPair(built(flight), navi, config, voltage=VOLTAGE)
        await asyncio.sleep(BOOTED)
        pair.advance(BOOTED)
        return await PairDaemon(pair, lambda: pair.world.held).run()

    return navi.release, run_virtually(run())


def show(flight: str, seeds: Sequence[int], jobs: int, *, as_json: bool) -> int:
    """Measure a pair, fly it, and show both; exit code 1 where sticks do not reach the FlightCtrl, or a flight is lost.

    Args:
        flight: name of a FlightCtrl that was built.
        seeds: one flight over the target with each; everything else is done with the first.
        jobs: processes that fly.
        as_json: print JSON in place of tables.
    """
    release, steps = measure(flight, seeds[0])
    rows: list[Row] = [{"what": step.name, "ended": step.ended, "figure": step.figure} for step in steps]
    is_reached = any((step.name, step.ended) == (REACHED, "yes") for step in steps)
    rows.append({"what": "the FlightCtrl held sticks", "ended": "yes" if is_reached else "no", "holds": is_reached})
    for row in fly_all(flight, seeds, jobs):
        figures: Row = {key: round(row[key], 2) for key in FIGURES if key in row}
        ended = "; ".join(row["lost"])
        rows.append({"what": f"flight {row['seed']}", "ended": ended, **figures, "holds": not row["lost"]})
    return tables.show(rows, ("what", "ended"), as_json=as_json, flight=flight, navi=release)
