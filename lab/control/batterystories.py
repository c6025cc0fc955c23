"""A battery that is low in flight, and the time until the flight ends; see `triggerstories`."""

from __future__ import annotations

from typing import Final

from lab.control.triggerrig import Scene
from lab.control.triggerstories import over_target
from mkdaemon.telemetry.control import Phase

EMPTY: Final = 9.0
"""Voltage of three cells that are low [V]."""


async def battery_lands(scene: Scene) -> float:
    """The battery is low over the target: a landing, from the first report on."""
    await over_target(scene)
    since = await battery_empty(scene)
    return await scene.until(lambda: scene.flown.flight.phase is Phase.LANDING) - since


async def battery_released(scene: Scene) -> float:
    """The battery is low without a target: release, from the first report on."""
    scene.client.is_seeing = False
    await scene.lean()
    return await scene.release_after(await battery_empty(scene))


async def battery_empty(scene: Scene) -> float:
    """Let the voltage fall; returns when the board first reports it [s]."""
    scene.bench.sensors.battery_voltage = EMPTY
    return await scene.until(lambda: scene.said["state/battery"]["voltage"] < EMPTY + 0.1)
