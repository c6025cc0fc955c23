"""`python -m lab hil --case pair`: a genuine FlightCtrl behind a genuine NaviCtrl, the daemon in front of both."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Sequence
from statistics import median
from typing import Any, Final

from rich.table import Table

from lab.hil.build import built
from lab.hil.navibuild import built_navictrl
from lab.hil.navidaemon import DaemonAtNavi, Step
from lab.hil.navipair import NaviPair
from lab.hil.quiet import be_quiet
from mkdaemon.cli.console import Console
from mkdaemon.virtualtime import run_virtually
from mksim.config import FlightConfig, PilotPlan, SimConfig, WindClass

BOOTED: Final = 10.0
"""Both boards need so long to find each other, compass and GPS receiver [s]."""
LOOK: Final = 4.0
SAMPLE: Final = 0.05
VOLTAGE: Final = 15.6


class PairDaemon(DaemonAtNavi):
    """A daemon at a genuine pair, whose telemetry is compared with what is true."""

    async def _hover(self) -> None:
        await super()._hover()
        world = self.aircraft.world
        errors: dict[str, list[float]] = {}
        for _ in range(round(LOOK / SAMPLE)):
            await asyncio.sleep(SAMPLE)
            values, truth = self.bus.values, world.truth
            attitude, pilot, height = (values.get(f"state/{name}") for name in ("attitude", "pilot", "altitude"))
            place = values.get("state/position")
            if attitude is not None and attitude.tilt is not None:
                errors.setdefault("tilt [deg]", []).append(abs(math.degrees(attitude.tilt - truth.tilt)))
            if pilot is not None and pilot.throttle_in_use is not None:
                errors.setdefault("throttle [count]", []).append(abs(pilot.throttle_in_use - world.pilot.gas))
            if height is not None:
                errors.setdefault("height [m]", []).append(abs(height.above_start - truth.position_enu[2]))
            if place is not None and place.position_enu is not None:
                east, north = place.position_enu[0], place.position_enu[1]
                off = math.hypot(east - truth.position_enu[0], north - truth.position_enu[1])
                errors.setdefault("place by GPS [m]", []).append(off)
        for name, found in errors.items():
            self._note(f"{name}, off by", "told", median(found))
        self._note("flies", "yes" if not truth.on_ground and not truth.crashed else "no", truth.position_enu[2])


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


def show(flight: str, seed: int, *, as_json: bool) -> int:
    """Measure a pair, and show it; exit code 1 where sticks do not reach the FlightCtrl.

    Args:
        flight: name of a FlightCtrl that was built.
        seed: of everything random.
        as_json: print JSON in place of a table.
    """
    release, steps = measure(flight, seed)
    if as_json:
        print(json.dumps(row_of(flight, release, steps)))
    else:
        table = Table("step", "ended", "figure", title=f"{flight} behind NaviCtrl {release}")
        for step in steps:
            table.add_row(step.name, step.ended, "" if step.figure is None else f"{step.figure:.3g}")
        Console().print(table)
    return 0 if any(step.name == "sticks reach the FlightCtrl" and step.ended == "yes" for step in steps) else 1


def row_of(flight: str, release: str, steps: Sequence[Step]) -> dict[str, Any]:
    """A pair's row as JSON has it."""
    return {"flight": flight, "navi": release, "steps": {step.name: [step.ended, step.figure] for step in steps}}
