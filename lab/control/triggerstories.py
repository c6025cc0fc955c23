"""Every trigger of the safety table: what is prepared, what happens, what follows. Source: docs/safety.md."""

from __future__ import annotations

import asyncio
import inspect
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Any, Final

from lab.control.triggerrig import ASIDE, CLIENT, HERE, LOOK, Scene
from lab.rigs.boardport import LineFault
from lab.rigs.cockpit import Boards
from mkdaemon.config.control import LimiterConfig
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.flightwatch import LASTING
from mkdaemon.control.manoeuvres.by_target import SEARCHES
from mkdaemon.control.manoeuvres.take_off import TakeOffLimits
from mkdaemon.control.modes import IN_FLIGHT
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
"""Poti that switches it here."""
LID: Final = 20
"""The pilot's throttle while the machine flies [stick]."""
IN_AIR: Final = 1.5
"""From a throttle that carries until a board reports that the aircraft flies [s]."""
CAPPING: Final = -60
"""A throttle below hover [stick]."""
EMPTY: Final = 9.0
"""Voltage of three cells that are low [V]."""
GENERATIONS: Final = (
    Boards("early"),
    Boards("2.08"),
    Boards("2.12a"),
    Boards("2.14"),
    Boards("2.12a", "0.24"),
    Boards("2.12a", "2.14"),
)
"""The boards that fly."""
DEAD_MAN: Final = {"early": 0.5, "2.08": 5.25, "2.12a": 2.05, "2.14": 2.05}
"""After the last stick frame the FlightCtrl holds the sticks for so long [s]; docs/safety.md."""
PROMPT: Final = 0.05
"""A trigger fires at its time, give or take this [s]: two control periods, and a frame on the wire."""
TELEMETRY: Final = 0.25
"""What only telemetry shows is known with its next message: 5 Hz, and the time on the wire [s]."""

# -- before it happens ------------------------------------------------------------------------------------------------


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


async def motors_on(scene: Scene) -> None:
    """Let the pilot start the motors and raise his throttle before the client flies."""
    scene.client.is_streaming = False
    await scene.start_motors()
    scene.bench.pilot.gas = LID
    scene.client.is_streaming = True


async def over_target_by_hand(scene: Scene) -> None:
    """The same, over the target."""
    await motors_on(scene)
    await over_target(scene)


async def switchable(scene: Scene) -> None:
    """The same with a set whose height control is switched by a poti."""
    flight = scene.flown.aircraft.flight
    switch = flight.live.channel(FIRST_POTI + HEIGHT_SWITCH - 1)
    enabled = Parameters(flight.live.with_value("global_config", flight.live["global_config"] | HEIGHT_CONTROL))
    flight.live = Parameters(enabled.with_value("altitude_channel", switch))
    await over_target_by_hand(scene)


async def lean_for_long(scene: Scene) -> None:
    """Fly by sticks, tilted, on motors that the pilot has started, for longer than a receiver needs."""
    await motors_on(scene)
    await scene.lean()
    await asyncio.sleep(3.0)


async def cut_off(scene: Scene) -> None:
    """The cable was pulled in flight, a second ago."""
    await scene.lean()
    scene.flown.socket.unplug()
    await gone(scene, 0.0)
    await asyncio.sleep(1.0)


async def on_the_ground(scene: Scene) -> None:
    """A client asks for a take-off that no image shows."""
    scene.client.is_seeing = False
    scene.client.setpoint = (TakeOffSetpoint, {"height": 2.0})
    await scene.start_motors()


# -- what happens; returns when, where that is not now [s] ------------------------------------------------------------


def stop_streaming(scene: Scene) -> float:
    """The client stops to stream."""
    scene.client.is_streaming = False
    return scene.client.last


def hide_target(scene: Scene) -> float:
    """The target is gone, or the detector stands still."""
    scene.client.is_seeing = False
    return scene.client.seen


async def take_off_blindly(scene: Scene) -> float:
    """The take-off begins; counts from 1.05 of hover throttle on."""
    engaged = await scene.until(lambda: scene.flown.flight.phase is Phase.FLYING)
    limits = TakeOffLimits()
    return engaged + limits.ready + limits.rises_for(LimiterConfig().hover_throttle + GAS_CENTRE)


def abort(scene: Scene) -> None:
    """Somebody aborts."""
    scene.flown.flight.abort(AbortRequest(reason="enough"))


async def release(scene: Scene, *, is_over: bool = False) -> float:
    """Somebody asks for a release; counts from the question, or from when it is over."""
    since = scene.loop.time()
    await scene.flown.flight.release(ReleaseRequest(reason="enough"))
    return scene.loop.time() if is_over else since


async def take_over(scene: Scene) -> float:
    """Another client takes the lease by force."""
    since = scene.loop.time()
    await scene.flown.flight.lease(LeaseRequest(action="take", holder="other", force=True))
    return since


async def switch_height_control(scene: Scene) -> float:
    """The pilot switches height control on."""
    scene.bench.pilot.switches[HEIGHT_SWITCH] = 255
    return await scene.until(lambda: scene.flown.aircraft.flight.core.height_control)


async def lose_receiver(scene: Scene) -> float:
    """The FlightCtrl loses the pilot's transmitter; counts from when it says so."""
    scene.bench.pilot.rc_quality = 0
    return await scene.until(lambda: scene.flown.aircraft.flight.core.emergency)


async def empty_battery(scene: Scene) -> float:
    """The voltage falls; counts from when the board first reports it."""
    scene.bench.sensors.battery_voltage = EMPTY
    return await scene.until(lambda: scene.said["state/battery"].voltage < EMPTY + 0.1)


def silence(scene: Scene, fault: LineFault = LineFault.SILENCE) -> float:
    """No board data comes, or random bytes in its place."""
    scene.port.inject(fault)
    return scene.flown.sink.heard_at


def deafen(scene: Scene) -> None:
    """The board does not hear us."""
    scene.port.inject(LineFault.ONE_WAY)


def deafen_after_frame(scene: Scene) -> float:
    """The same; counts from the last frame that it heard."""
    deafen(scene)
    return scene.flown.sink.tx[-1].at


async def plug_in(scene: Scene) -> float:
    """The cable is plugged in again; the client streams on."""
    socket = scene.flown.socket
    openings, socket.is_present = socket.openings, True
    return await scene.until(lambda: socket.openings > openings)


def stall(scene: Scene) -> float:
    """The daemon stands still for longer than a setpoint lives."""
    assert isinstance(scene.loop, VirtualLoop)
    scene.loop.let_pass(0.4)
    return scene.loop.time()


def hang(scene: Scene) -> float:
    """The control loop hangs; counts from the last frame that it sent."""
    scene.flown.tasks[1].cancel()
    return scene.flown.sink.tx[-1].at


def move_stick(scene: Scene) -> None:
    """The pilot moves a stick."""
    scene.before = scene.flown.aircraft.flight.core.mixed.roll
    scene.bench.pilot.roll = 40


# -- what is measured: a time from a moment on [s] --------------------------------------------------------------------


async def searches(scene: Scene, since: float) -> float:
    """The aircraft searches for the target."""
    return await scene.until(lambda: scene.said["control/status"].stage == SEARCHES) - since


async def searches_and_goes_on(scene: Scene, since: float) -> float:
    """The same; 2 s later the target is seen again, and the flight goes on."""
    took = await searches(scene, since)
    await asyncio.sleep(since + 2.0 - scene.loop.time())
    scene.client.is_seeing = True
    await asyncio.sleep(0.5)
    goes_on = scene.flown.flight.phase is Phase.FLYING and scene.said["control/status"].stage == ""
    return took if goes_on else math.inf


async def gone(scene: Scene, since: float) -> float:
    """The flight has ended."""
    return await scene.until(lambda: scene.flown.flight.phase not in IN_FLIGHT) - since


async def release_only(scene: Scene, since: float) -> float:
    """A release is sent, and no stick frame."""
    took = await scene.release_after(since)
    return math.inf if scene.sticks_since(since) else took


async def release_first(scene: Scene, since: float) -> float:
    """The first thing that is sent, after the questions who is there, is a release."""

    def said() -> Any:
        sent = (one for one in scene.flown.sink.tx if one.at > since - LOOK)
        return next((one for one in sent if one.purpose is not Purpose.REQUEST), None)

    await scene.until(lambda: said() is not None)
    first = said()
    return first.at - since if first.purpose is Purpose.RELEASE else math.inf


async def no_sticks(scene: Scene, since: float) -> float:
    """No stick frame leaves for 2 s, though a client streams on."""
    await asyncio.sleep(2.0)
    return math.inf if scene.sticks_since(since) else 0.0


async def guard_writes(scene: Scene, since: float) -> float:
    """The guard sends neutral sticks."""
    await scene.until(lambda: bool(scene.guard.written))
    return scene.guard.written[0][0] - since


async def stick_acts(scene: Scene, since: float) -> float:
    """The FlightCtrl adds the pilot's stick to ours."""
    core = scene.flown.aircraft.flight.core
    return await scene.until(lambda: core.controlled and abs(core.mixed.roll - scene.before) > 30) - since


def holds(claim: Callable[[Scene], bool]) -> Callable[[Scene, float], Awaitable[float]]:
    """Something begins to hold."""

    async def measure(scene: Scene, since: float) -> float:
        return await scene.until(lambda: claim(scene)) - since

    return measure


class Shown(Enum):
    """Which boards show an event to the daemon, or to this rig."""

    EVERYWHERE = "everywhere"
    ON_A_CABLE = "on a cable to the FlightCtrl"
    BY_A_NAVICTRL = "by a NaviCtrl"


@dataclass(frozen=True, slots=True)
class Trigger:
    """One time of a row of the safety table.

    Attributes:
        name: of what happens.
        event: the row, as docs/safety.md names it.
        prepare: the flight before it.
        act: lets it happen; returns when it did, where that is not now [s].
        measure: what follows, and after how long [s].
        at: when it has to fire [s]; None for the dead-man of the boards that fly.
        shown: where it can happen, or be seen.
        slack: beside the share of the time [s].
    """

    name: str
    event: str
    prepare: Callable[[Scene], Awaitable[None]]
    act: Callable[[Scene], Any]
    measure: Callable[[Scene, float], Awaitable[float]]
    at: float | None
    shown: Shown = Shown.EVERYWHERE
    slack: float = PROMPT

    @property
    def boards(self) -> tuple[Boards, ...]:
        """The boards it is seen on."""
        hidden = {Shown.ON_A_CABLE: True, Shown.BY_A_NAVICTRL: False}.get(self.shown)
        return tuple(boards for boards in GENERATIONS if (boards.nc is not None) is not hidden)

    def time(self, boards: Boards) -> float:
        """When it has to fire with these boards [s]."""
        return DEAD_MAN[boards.fc] if self.at is None else self.at

    async def fire(self, scene: Scene) -> float:
        """Let it happen; the time that it took [s]."""
        await self.prepare(scene)
        since, found = scene.loop.time(), self.act(scene)
        at = await found if inspect.isawaitable(found) else found
        return await self.measure(scene, since if at is None else at)


lean, released, level = Scene.lean, Scene.release_after, Scene.level_after
BLIND: Final = "the target is out of sight"
BATTERY: Final = "the battery is low"
NO_DATA: Final = "no data from the boards, or no answers"
NO_LINK: Final = "the link is down or absent"
SWITCHES: Final = "height control on, or GPS switch not at free, in flight by position"
PILOT: Final = "the pilot closes the gate or moves a stick"
GUARD: Final = "the daemon hangs or dies"
ENDED: Final = "`mkctl release`, or another client takes the lease with `--force`"
TRIGGERS: Final = (
    Trigger("stale", "the newest setpoint is too old", lean, stop_streaming, level, 0.3),
    Trigger("silent", "still no setpoint", lean, stop_streaming, released, 1.0),
    Trigger(
        *("client_gone", "the client's session ends", over_target),
        *(lambda scene: scene.flown.flight.client_changed(CLIENT, is_here=False), released, 0.0),
    ),
    Trigger(
        *("blind_frozen", BLIND, over_target, hide_target),
        *(holds(lambda scene: tuple(scene.said["control/error"].goal) != ASIDE["position"]), 0.2),
    ),
    Trigger("blind_searches", BLIND, over_target, hide_target, searches, 1.0),
    Trigger("blind_release", BLIND, over_target, hide_target, released, 3.0),
    Trigger("eyes_stalled", BLIND, over_target, hide_target, searches_and_goes_on, 1.0),
    Trigger("blind_takeoff", "no image confirms a take-off", on_the_ground, take_off_blindly, released, 1.2),
    Trigger(
        *("battery_lands", BATTERY, over_target, empty_battery),
        *(holds(lambda scene: scene.flown.flight.phase is Phase.LANDING), LASTING),
    ),
    Trigger("battery_released", BATTERY, lean, empty_battery, released, LASTING),
    Trigger(
        *("aborted", "`mkctl abort`", over_target, abort),
        *(holds(lambda scene: scene.flown.flight.phase is Phase.ABORTED), 0.0),
    ),
    Trigger("release_asked", ENDED, over_target, release, released, 0.0),
    Trigger("taken_over", ENDED, over_target, take_over, released, 0.0),
    Trigger("line_silent", NO_DATA, lean, silence, released, 1.0),
    Trigger("line_garbage", NO_DATA, lean, partial(silence, fault=LineFault.GARBAGE), released, 1.0),
    Trigger(
        *("one_way", NO_DATA, lean, deafen),
        *(holds(lambda scene: scene.flown.flight.phase not in (Phase.FLYING, Phase.STALE)), 1.5),
    ),
    Trigger("unplugged", NO_LINK, lean, lambda scene: scene.flown.socket.unplug(), gone, 0.0),
    Trigger("replugged", NO_LINK, cut_off, plug_in, release_first, 0.03),
    Trigger(
        *("dead_man", "nothing reaches the FlightCtrl", lean, deafen_after_frame),
        *(holds(lambda scene: not scene.flown.aircraft.is_controlled), None, Shown.ON_A_CABLE),
    ),
    Trigger(
        *("height_control", SWITCHES, switchable, switch_height_control, released, 0.0),
        shown=Shown.BY_A_NAVICTRL,
        slack=TELEMETRY + PROMPT,
    ),
    Trigger(
        *("gps_switch", SWITCHES, over_target),
        *(lambda scene: scene.bench.pilot.switches.update({GPS_SWITCH: GPS_SWITCH_VALUES["hold"]}), released, 0.0),
        shown=Shown.BY_A_NAVICTRL,
        slack=TELEMETRY + PROMPT,
    ),
    Trigger(
        *("throttle_capped", "the pilot's throttle is lower than ours", over_target_by_hand),
        lambda scene: setattr(scene.bench.pilot, "gas", CAPPING),
        *(holds(lambda scene: scene.said["control/status"].pilots_throttle is not None), 0.4),
        slack=2 * TELEMETRY,
    ),
    Trigger("receiver_lost", "the receiver is lost", lean_for_long, lose_receiver, released, 0.0, slack=TELEMETRY),
    Trigger("daemon_stalled", "the daemon did not run for 0.3 s", over_target, stall, release_only, 0.0),
    Trigger("guard_neutral", GUARD, over_target, hang, guard_writes, 0.25),
    Trigger("guard_release", GUARD, over_target, hang, holds(lambda scene: scene.guard.guard.is_releasing), 0.8),
    Trigger(
        *("gate_shut", PILOT, lean, lambda scene: setattr(scene.bench.pilot, "gate", 0)),
        *(holds(lambda scene: not scene.flown.aircraft.applied[-1].is_valid), 0.0),
    ),
    Trigger("pilots_stick", PILOT, lean, move_stick, stick_acts, 0.0),
    Trigger("no_lease", "no client holds the lease", over_target, partial(release, is_over=True), no_sticks, 0.0),
)
"""Every trigger of docs/safety.md, "What ends a flight"."""
