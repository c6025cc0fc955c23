"""What happens to the line and the battery of a flight, and the time that it took; see `triggerstories`."""

from __future__ import annotations

import asyncio
import math
from typing import Final

from lab.control.triggerrig import Scene
from lab.control.triggerstories import over_target
from lab.rigs.boardport import LineFault
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.telemetry.control import Phase

EMPTY: Final = 9.0
"""Voltage of three cells that are low [V]."""


async def line_silent(scene: Scene, fault: LineFault = LineFault.SILENCE) -> float:
    """No board data: the lease ends, a release is sent."""
    await scene.lean()
    heard = scene.flown.sink.heard_at
    scene.port.inject(fault)
    return await scene.release_after(heard)


async def line_garbage(scene: Scene) -> float:
    """Random bytes in place of board data: the same."""
    return await line_silent(scene, LineFault.GARBAGE)


async def unplugged(scene: Scene) -> float:
    """The cable is pulled: the lease ends."""
    await scene.lean()
    since = scene.loop.time()
    scene.flown.socket.unplug()
    return await scene.until(lambda: scene.flown.flight.phase not in IN_FLIGHT) - since


async def replugged(scene: Scene) -> float:
    """The cable is plugged in again: after the questions who is there a release is first, though the client streams."""
    await unplugged(scene)
    await asyncio.sleep(1.0)
    socket, tx = scene.flown.socket, scene.flown.sink.tx
    openings, before = socket.openings, len(tx)
    socket.is_present = True
    opened = await scene.until(lambda: socket.openings > openings)
    await scene.until(lambda: any(sent.purpose is not Purpose.REQUEST for sent in tx[before:]))
    first = next(sent for sent in tx[before:] if sent.purpose is not Purpose.REQUEST)
    return first.at - opened if first.purpose is Purpose.RELEASE else math.inf


async def one_way(scene: Scene) -> float:
    """The board does not hear us: the lease ends after the verdict of 0.5 s and 1 s of patience."""
    await scene.lean()
    scene.port.inject(LineFault.ONE_WAY)
    since = scene.loop.time()
    return await scene.until(lambda: scene.flown.flight.phase not in (Phase.FLYING, Phase.STALE)) - since


async def dead_man(scene: Scene) -> float:
    """Nothing of ours arrives any more: the FlightCtrl itself drops the sticks."""
    await scene.lean()
    last = scene.flown.sink.tx[-1].at
    scene.port.inject(LineFault.ONE_WAY)
    return await scene.until(lambda: not scene.flown.aircraft.is_controlled) - last


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
