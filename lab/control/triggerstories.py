"""What happens to a flight, one story for each trigger of the safety table, and the time that it took."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Final

from lab.control.triggerrig import ASIDE, CLIENT, HERE, Scene
from mkdaemon.config.control import LimiterConfig
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.manoeuvres.by_target import SEARCHES
from mkdaemon.control.manoeuvres.take_off import TakeOffLimits
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.telemetry.command import AbortRequest, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, TakeOffSetpoint
from mkdaemon.virtualtime import VirtualLoop
from mksim.boards.parameters import FIRST_POTI, Parameters
from mksim.physics.pilot import GPS_SWITCH, GPS_SWITCH_VALUES

HEIGHT_CONTROL: Final = 0x01
"""Bit of GlobalConfig: height control can be switched on."""
HEIGHT_SWITCH: Final = 3
"""Poti that switches it in these stories."""
LID: Final = 20
"""The pilot's throttle while the machine flies [stick]."""
IN_AIR: Final = 1.5
"""From a throttle that carries until a board reports that the aircraft flies [s]."""
CAPPING: Final = -60
"""A throttle below hover [stick]."""

Story = Callable[[Scene], Awaitable[float]]


async def stale(scene: Scene) -> float:
    """The client stops to stream: neutral sticks."""
    await scene.lean()
    scene.client.is_streaming = False
    return await scene.level_after(scene.client.last)


async def silent(scene: Scene) -> float:
    """The client stops to stream: release."""
    await scene.lean()
    scene.client.is_streaming = False
    return await scene.release_after(scene.client.last)


async def client_gone(scene: Scene) -> float:
    """The client's session ends: release."""
    await over_target(scene)
    scene.flown.flight.client_changed(CLIENT, is_here=False)
    return await scene.release_after(scene.loop.time())


async def over_target(scene: Scene) -> None:
    """Fly by positions, leaning towards one beside the aircraft that the pilot has brought into the air."""
    await scene.start_motors()
    scene.bench.pilot.gas = LID
    await asyncio.sleep(IN_AIR)
    scene.client.setpoint = (PositionSetpoint, HERE)
    await scene.until(lambda: scene.flown.flight.phase is Phase.FLYING)
    await asyncio.sleep(0.5)
    scene.client.setpoint = (PositionSetpoint, ASIDE)
    await asyncio.sleep(0.5)


async def blind_frozen(scene: Scene) -> float:
    """The target is gone: the reference stands still, short of the place that is asked for."""
    await over_target(scene)
    scene.client.is_seeing = False
    since = scene.client.seen
    return await scene.until(lambda: tuple(scene.said["control/error"]["goal"]) != ASIDE["position"]) - since


async def blind_searches(scene: Scene) -> float:
    """The target is gone: the aircraft searches for it."""
    await over_target(scene)
    scene.client.is_seeing = False
    since = scene.client.seen
    return await scene.until(lambda: scene.said["control/status"]["stage"] == SEARCHES) - since


async def blind_release(scene: Scene) -> float:
    """The target stays gone: release."""
    await over_target(scene)
    scene.client.is_seeing = False
    return await scene.release_after(scene.client.seen)


async def eyes_stalled(scene: Scene) -> float:
    """The detector stands still for 2 s: the aircraft searches meanwhile, then the flight goes on."""
    await over_target(scene)
    scene.client.is_seeing = False
    since = scene.client.seen
    searches = await scene.until(lambda: scene.said["control/status"]["stage"] == SEARCHES)
    await asyncio.sleep(since + 2.0 - scene.loop.time())
    scene.client.is_seeing = True
    await asyncio.sleep(0.5)
    goes_on = scene.flown.flight.phase is Phase.FLYING and scene.said["control/status"]["stage"] == ""
    return searches - since if goes_on else math.inf


async def blind_takeoff(scene: Scene) -> float:
    """A take-off that no image shows: release, from 1.05 of hover throttle on."""
    scene.client.is_seeing = False
    scene.client.setpoint = (TakeOffSetpoint, {"height": 2.0})
    await scene.start_motors()
    engaged = await scene.until(lambda: scene.flown.flight.phase is Phase.FLYING)
    limits = TakeOffLimits()
    strong = engaged + limits.ready + limits.rises_for(LimiterConfig().hover_throttle + GAS_CENTRE)
    return await scene.release_after(engaged) - (strong - engaged)


async def aborted(scene: Scene) -> float:
    """Somebody aborts: the manoeuvre stops."""
    await over_target(scene)
    since = scene.loop.time()
    scene.flown.flight.abort(AbortRequest(reason="enough"))
    return await scene.until(lambda: scene.flown.flight.phase is Phase.ABORTED) - since


async def release_asked(scene: Scene) -> float:
    """Somebody asks for a release."""
    await over_target(scene)
    since = scene.loop.time()
    asking = asyncio.create_task(scene.flown.flight.release(ReleaseRequest(reason="enough")))
    took = await scene.release_after(since)
    await asking
    return took


async def taken_over(scene: Scene) -> float:
    """Another client takes the lease by force."""
    await over_target(scene)
    since = scene.loop.time()
    await scene.flown.flight.lease(LeaseRequest(action="take", holder="other", force=True))
    return await scene.release_after(since)


async def no_lease(scene: Scene) -> float:
    """Nobody holds the lease, and a client streams on: no stick frame leaves."""
    await over_target(scene)
    await scene.flown.flight.release(ReleaseRequest(reason="enough"))
    released = scene.loop.time()
    await asyncio.sleep(2.0)
    return math.inf if scene.sticks_since(released) else 0.0


async def height_control(scene: Scene) -> float:
    """The pilot switches height control on: release."""
    flight = scene.flown.aircraft.flight
    switch = flight.live.channel(FIRST_POTI + HEIGHT_SWITCH - 1)
    enabled = Parameters(flight.live.with_value("global_config", flight.live["global_config"] | HEIGHT_CONTROL))
    flight.live = Parameters(enabled.with_value("altitude_channel", switch))
    await motors_on(scene)
    await over_target(scene)
    scene.bench.pilot.switches[HEIGHT_SWITCH] = 255
    return await scene.release_after(await scene.until(lambda: flight.core.height_control))


async def gps_switch(scene: Scene) -> float:
    """The pilot turns his GPS switch to hold: release."""
    await over_target(scene)
    scene.bench.pilot.switches[GPS_SWITCH] = GPS_SWITCH_VALUES["hold"]
    return await scene.release_after(scene.loop.time())


async def throttle_capped(scene: Scene) -> float:
    """The pilot's throttle is lower than ours: `control/status` says so."""
    await motors_on(scene)
    await over_target(scene)
    scene.bench.pilot.gas = CAPPING
    since = scene.loop.time()
    return await scene.until(lambda: scene.said["control/status"]["pilots_throttle"] is not None) - since


async def motors_on(scene: Scene) -> None:
    """Let the pilot start the motors and raise his throttle before the client flies."""
    scene.client.is_streaming = False
    await scene.start_motors()
    scene.bench.pilot.gas = LID
    scene.client.is_streaming = True


async def receiver_lost(scene: Scene) -> float:
    """The FlightCtrl says that it has lost the pilot's transmitter."""
    await motors_on(scene)
    pilot, core = scene.bench.pilot, scene.flown.aircraft.flight.core
    await scene.lean()
    await asyncio.sleep(3.0)
    pilot.rc_quality = 0
    return await scene.release_after(await scene.until(lambda: core.emergency))


async def daemon_stalled(scene: Scene) -> float:
    """The daemon stands still for longer than a setpoint lives: the first thing it sends is a release."""
    await over_target(scene)
    assert isinstance(scene.loop, VirtualLoop)
    scene.loop.let_pass(0.4)
    woken = scene.loop.time()
    took = await scene.release_after(woken)
    moved = [sent for sent in scene.flown.sink.tx if sent.at > woken and sent.purpose is Purpose.SETPOINT]
    return math.inf if moved else took


async def guard_neutral(scene: Scene) -> float:
    """The control loop hangs: the guard sends neutral sticks."""
    await over_target(scene)
    scene.flown.tasks[1].cancel()
    last = scene.flown.sink.tx[-1].at
    await scene.until(lambda: bool(scene.guard.written))
    return scene.guard.written[0][0] - last


async def guard_release(scene: Scene) -> float:
    """The control loop hangs: the guard releases."""
    await over_target(scene)
    scene.flown.tasks[1].cancel()
    last = scene.flown.sink.tx[-1].at
    await scene.until(lambda: scene.guard.guard.is_releasing)
    return scene.loop.time() - last


async def gate_shut(scene: Scene) -> float:
    """The pilot shuts the gate: the FlightCtrl itself ignores our sticks."""
    await scene.lean()
    scene.bench.pilot.gate = 0
    since = scene.loop.time()
    return await scene.until(lambda: not scene.flown.aircraft.applied[-1].is_valid) - since


async def pilots_stick(scene: Scene) -> float:
    """The pilot moves a stick: the FlightCtrl adds it to ours at once."""
    await scene.lean()
    core = scene.flown.aircraft.flight.core
    before = core.mixed.roll
    scene.bench.pilot.roll = 40
    since = scene.loop.time()
    return await scene.until(lambda: core.controlled and abs(core.mixed.roll - before) > 30) - since
