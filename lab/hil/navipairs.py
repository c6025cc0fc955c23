"""`python -m lab hil --case pair`: a genuine FlightCtrl behind a genuine NaviCtrl, the daemon in front of both.

Its own code does its work there first; then it flies over the target: take-off, a hold in indoor air and a landing,
with the rendered camera of `lab.hil.flights`. Attitudes, telemetry and sticks cross both boards.
"""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from statistics import median
from typing import Any, Final

from lab import tables
from lab.campaign import Row, in_order
from lab.hil.build import built, built_navictrl
from lab.hil.flights import Leg, SceneFlight, Setting, config_of
from lab.hil.naviaircraft import NaviPair
from lab.hil.navidaemon import NEUTRAL, DaemonAtNavi
from lab.hil.processes import be_quiet
from mkdaemon.virtualtime import run_virtually
from mksim.config import FlightConfig, PilotPlan, SimConfig, WindClass
from mksim.physics.truth import Truth
from mksim.physics.world import StartState
from mksim.programs.rehearsal import land, over_pad, take_off
from mksim.scene.camera import deck_of

VOLTAGE: Final = 15.6
BOOTED: Final = 10.0
"""Both boards need so long to find each other, compass and GPS receiver [s]."""
START: Final = 14.0
"""When the pilot starts the motors [s]: a FlightCtrl behind a NaviCtrl is asked for its release before."""
HOLD: Final = 20.0
LEG: Final = Leg((take_off(), over_pad("hold", 0.0, HOLD), land()))
LOOK: Final = 2.0
SAMPLE: Final = 0.05
TRIES: Final = 3
"""Times that the cable is cut, and that the client falls silent."""
TILTS: Final = 20
"""Setpoints with a tilt before each."""
TILT: Final = 5.0
"""[count]."""
REACHED: Final = "sticks reach the FlightCtrl"
FIGURES: Final = ("hold_cm", "touch_cm", "nees_level")
"""Of a flight; see `lab.hil.flights.figures`."""
SLOWEST: Final = 8.0
"""Longest that sticks are waited for to be dropped [s]."""


class PairDaemon(DaemonAtNavi):
    """A daemon at a genuine pair, whose telemetry is compared with what is true."""

    async def _do_steps(self) -> None:
        await self._meet()
        await self._pass_on()
        await self._control()

    def _note(self, what: str, ended: str, figure: float | None = None) -> None:
        super()._note(what, ended, figure)
        print(f"{self.loop.time():.1f} s: {what}: {ended} {figure}", file=sys.stderr, flush=True)

    async def _hover(self) -> None:
        await super()._hover()
        errors = dict[str, list[float]]()
        for _ in range(round(LOOK / SAMPLE)):
            await asyncio.sleep(SAMPLE)
            for name, value in errors_of(self.bus.values, self.world.truth, self.world.pilot.gas).items():
                errors.setdefault(name, []).append(value)
        for name, found in errors.items():
            self._note(f"{name}, off by", "measured", median(found))

    async def _dead_man(self) -> None:
        """The cable is cut, and the client falls silent, in turn, while a tilt is held."""
        for number in range(1, TRIES + 1):
            self.cable.is_cut = self.cable.is_deaf = True
            await self._wait(f"cable cut, held for ({number})", lambda: not self._held()[4], SLOWEST, self._streamed_at)
            self.cable.is_cut = self.cable.is_deaf = False
            await self._steer_again(number)
            await self._wait(
                f"client silent, level after ({number})", lambda: self._held()[0] == 0, SLOWEST, self._streamed_at
            )
            await self._wait(
                f"client silent, let go after ({number})", lambda: not self._held()[4], SLOWEST, self._streamed_at
            )
            if number < TRIES:
                await self._steer_again(number)

    async def _steer_again(self, number: int) -> None:
        """Take the lease once the aircraft is known again, and ask for a tilt."""
        if await self.until(lambda: self.is_line_known, SLOWEST) is None:
            self._note(f"known again ({number})", "never")
            return
        await asyncio.sleep(LOOK)
        await self.bus.take_lease("lab")
        await self._stream(NEUTRAL, 0.0)
        await self._stream(TILTS, TILT)


def errors_of(values: Mapping[str, Any], truth: Truth, throttle: int) -> dict[str, float]:
    """How far telemetry, the newest of every key, is off the truth and the pilot's throttle [stick]."""
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
        found["place by GPS [m]"] = math.dist(place.position_enu[:2], truth.position_enu[:2])
    return found


def measure(flight: str, seed: int) -> tuple[str, list[Row]]:
    """Let the daemon do everything at a pair; the NaviCtrl's release, and what became of each step.

    Raises:
        ConfigError: something is not built.
    """
    be_quiet()
    navi, wind = built_navictrl(), FlightConfig(wind=WindClass.INDOOR)
    config = SimConfig(seed=seed, pilot_plan=PilotPlan.NOTHING, flight=wind)

    async def run() -> list[Row]:
        pair = await _booted(flight, config)
        return await PairDaemon(pair, lambda: pair.world.held).run()

    return navi.release, run_virtually(run())


async def _booted(flight: str, config: SimConfig, **more: Any) -> NaviPair:
    """Both boards, once they know each other."""
    pair = NaviPair(built(flight), built_navictrl(), config, voltage=VOLTAGE, **more)
    await asyncio.sleep(BOOTED)
    pair.advance(BOOTED)
    return pair


def fly_pair(flight: str, seed: int) -> Row:
    """Fly once over the target; a process does it once, for it has one NaviCtrl."""
    be_quiet()
    return run_virtually(_fly(flight, seed)) | {"seed": seed}


async def _fly(flight: str, seed: int) -> Row:
    setting = Setting(flight, seed, voltage=VOLTAGE)
    config = config_of(setting).model_copy(update={"pilot_wait": START})
    pair = await _booted(flight, config, start=StartState(yaw=setting.yaw), ground=deck_of(config.scene.platform))
    scenes = SceneFlight(config, pair, (LEG,))
    await scenes.fly()
    return scenes.found


def show(flight: str, seeds: Sequence[int], jobs: int, *, as_json: bool) -> int:
    """Measure a pair with the first seed, fly it with each, and show both.

    Returns:
        Exit code: 1 where sticks do not reach the FlightCtrl, or a flight is lost.
    """
    release, steps = measure(flight, seeds[0])
    rows = [step | {"holds": step["what"] != REACHED or step["ended"] == "yes"} for step in steps]
    rows.append({"what": "control was had", "holds": any(step["what"] == REACHED for step in steps)})
    for row in in_order(partial(fly_pair, flight), seeds, jobs, is_alone=True):
        figures: Row = {key: round(row[key], 2) for key in FIGURES if key in row}
        rows.append({"what": f"flight {row['seed']}", "lost": row["lost"], **figures, "holds": not row["lost"]})
    return tables.show(rows, ("what",), as_json=as_json, flight=flight, navi=release)
