"""Flights over the target by a genuine FlightCtrl whose sticks come through a genuine NaviCtrl.

The daemon is at the NaviCtrl's port: attitudes, telemetry and sticks cross both boards. Take-off, a hold in indoor air
and a landing, with the rendered camera of `lab.hil.flights`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

from lab.campaign import in_order
from lab.hil.build import built
from lab.hil.flights import Leg, SceneFlight, Setting, config_of
from lab.hil.navibuild import built_navictrl
from lab.hil.navipair import NaviPair
from lab.hil.quiet import be_quiet
from mkdaemon.virtualtime import run_virtually
from mksim.physics.world import StartState
from mksim.programs.rehearsal import land, over_pad, take_off
from mksim.scene.camera import deck_of

VOLTAGE: Final = 15.6
BOOTED: Final = 10.0
"""Both boards need so long to find each other, compass and GPS receiver [s]."""
START: Final = 14.0
"""When the pilot starts the motors [s]: a FlightCtrl behind a NaviCtrl is asked for its release before."""
HOLD: Final = 20.0
LEGS: Final = (Leg((take_off(), over_pad("hold", 0.0, HOLD), land())),)


def fly_all(flight: str, seeds: Sequence[int], jobs: int) -> list[dict[str, Any]]:
    """Fly once with each seed, each in a process of its own; figures as `lab.hil.flights.figures` has them.

    Args:
        flight: name of a FlightCtrl that was built.
        seeds: of everything random.
        jobs: processes.
    """
    return in_order(partial(fly_pair, flight), seeds, jobs, is_alone=True)


def fly_pair(flight: str, seed: int) -> dict[str, Any]:
    """Fly once; a process does it once, for it has one NaviCtrl."""
    be_quiet()
    return run_virtually(_fly(flight, seed)) | {"seed": seed}


async def _fly(flight: str, seed: int) -> dict[str, Any]:
    setting = Setting(flight, seed, voltage=VOLTAGE)
    config = config_of(setting).model_copy(update={"pilot_wait": START})
    deck = deck_of(config.scene.platform)
    start = StartState(yaw=setting.yaw)
    pair = NaviPair(built(flight), built_navictrl(), config, voltage=VOLTAGE, start=start, ground=deck)
    await asyncio.sleep(BOOTED)
    pair.advance(BOOTED)
    scenes = SceneFlight(config, pair, LEGS)
    await scenes.fly()
    return scenes.found
