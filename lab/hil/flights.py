"""One flight of the proving ground: the same scene on simulated boards or on genuine firmware, and its figures."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from mkdaemon.control.estimator.model import STICK_FILTER
from mkdaemon.telemetry.control import ControlEstimate, ControlStatus
from mkdaemon.telemetry.event import LogEvent
from mkdaemon.virtualtime import run_virtually
from mksim.config import BatteryConfig, FlightConfig, PilotPlan, SimConfig, WindClass
from mksim.physics.battery import OPEN_CIRCUIT_V
from mksim.physics.deck import MovingDeck
from mksim.physics.world import StartState, World
from mksim.programs.flightrecord import Moment
from mksim.programs.rehearsal import FlightPart, FlyingAircraft, Rehearsal, land, over_pad, take_off
from mksim.scene.camera import DECK_RADIUS_M, platform_of
from mksim.simulation import Simulation

Array = npt.NDArray[np.float64]

BOOTED: Final = 8.0
"""When the pilot touches his sticks [s]: genuine boards need seven seconds to start."""
SETTLED: Final = 5.0
"""Figures of a hold are taken after this [s]."""
PAD_STARTS: Final = 40.0
"""A pad that moves stands until then [s]."""
TRUTH_PERIOD: Final = 0.01
"""[s]."""
STEP: Final = 1.0
"""Length of the step [m]."""

WHOLE: Final = (
    take_off(),
    over_pad("hold", 0.0, 25.0),
    over_pad("aside", -STEP / 2),
    over_pad("aside", -STEP / 2, 3.0),
    over_pad("step", STEP / 2, 8.0),
    over_pad("back", 0.0),
    over_pad("light", 0.0, 20.0, wind=WindClass.LIGHT),
    over_pad("moderate", 0.0, 20.0, wind=WindClass.MODERATE),
    over_pad("calms", 0.0, 4.0, wind=WindClass.LIGHT),
    land(),
)
"""Take-off, hold in three winds, a step of 1 m, landing in light wind."""
SHORT: Final = (take_off(), over_pad("hold", 0.0, 20.0), land())
FOLLOWING: Final = (
    take_off(),
    over_pad("hold", 0.0, 5.0),
    over_pad("light", 0.0, until=PAD_STARTS + 1.0, wind=WindClass.LIGHT),
    over_pad("follow", 0.0, 8.0),
    land(),
)
"""The pad moves, and the landing is on it."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What is flown, and on what.

    Attributes:
        firmware: name of a firmware that `make hil` built; None flies the simulator's boards.
        parts: of the flight.
        seed: of everything random.
        is_radio: a radio instead of a cable.
        voltage: of the battery [V]; held by genuine boards, the simulator begins with it.
        has_compass: the board hears of the heading.
        yaw: at the start [rad; ENU].
        pad_speed: of the target, once it moves [m/s].
        fps: images a second.
    """

    firmware: str | None
    parts: Sequence[FlightPart]
    seed: int
    is_radio: bool = False
    voltage: float = 14.8
    has_compass: bool = True
    yaw: float = math.pi / 2
    pad_speed: float = 0.0
    fps: float = 30.0


@dataclass(slots=True)
class Flown:
    """What happened.

    Attributes:
        truth: time [s], true position from the middle of the target (3) [m], vertical speed [m/s], 1 on the ground.
        estimates: of every estimate: time [s], position (3) [m], standard deviations (3) [m], stick filter [s].
        warnings: of the daemon, with their times [s].
        parts: begin of each [s].
        outcome: why the flight ended.
        crashed: why the aircraft broke; empty while whole.
    """

    truth: list[tuple[float, ...]] = field(default_factory=list)
    estimates: list[tuple[float, ...]] = field(default_factory=list)
    warnings: list[tuple[float, str]] = field(default_factory=list)
    parts: dict[str, float] = field(default_factory=dict)
    outcome: str = ""
    crashed: str = ""


def fly(setting: Setting) -> dict[str, Any]:
    """Fly once in virtual time, and return the figures; see `figures`."""
    return figures(run_virtually(_fly(setting)))


async def _fly(setting: Setting) -> Flown:
    config = config_of(setting)
    platform = platform_of(config.scene.platform)
    deck = MovingDeck(lambda time: platform.pose_at(time).position_enu, radius=DECK_RADIUS_M)
    start = StartState(yaw=setting.yaw)
    aircraft: FlyingAircraft
    if setting.firmware is None:
        aircraft = Simulation(config, World(config.flight, seed=setting.seed, start=start, ground=deck))
    else:
        aircraft = GenuineAircraft(
            built(setting.firmware),
            config,
            start=start,
            ground=deck,
            voltage=setting.voltage,
            has_compass=setting.has_compass,
        )
    flown, truth, kept = Flown(), aircraft.world.truth, -math.inf

    def watch_truth(now: float) -> None:
        nonlocal kept
        if now - kept >= TRUTH_PERIOD - 1e-9:
            kept = now
            x, y, z = (float(part) for part in truth.position_enu - platform.pose_at(now).position_enu)
            flown.truth.append((now, x, y, z, float(truth.velocity_enu[2]), float(truth.on_ground)))

    def hear(suffix: str, value: BaseModel) -> None:
        if isinstance(value, ControlEstimate):
            flown.estimates.append(
                (value.stamp.monotonic, *value.position, *value.position_sd, value.stick_filter, value.hover_throttle)
            )
        elif isinstance(value, LogEvent) and value.level != "info":
            flown.warnings.append((value.stamp.monotonic, value.text))

    rehearsal = Rehearsal(config, aircraft, _unwatched, setting.parts, moved=watch_truth)
    rehearsal.bus.followers.append(hear)
    record = await rehearsal.fly()
    flown.parts, flown.outcome, flown.crashed = record.parts, record.outcome, record.crashed
    return flown


def _unwatched(moment: Moment, status: ControlStatus | None) -> None:
    """Nobody looks."""


def config_of(setting: Setting) -> SimConfig:
    """What the simulator is told of a setting."""
    pad: dict[str, Any] = {"kind": "still"}
    if setting.pad_speed:
        heading = random.Random(f"{setting.seed} pad").uniform(0.0, 360.0)
        pad = {
            "kind": "ramp",
            "speed": setting.pad_speed,
            "acceleration": 0.25,
            "delay": PAD_STARTS,
            "heading_deg": heading,
        }
    line = {"kind": "xbee"} if setting.is_radio else {"kind": "wired"}
    scene: dict[str, Any] = {"enabled": True, "fps": setting.fps, "exposure_ms": 6.0, "platform": pad}
    return SimConfig.model_validate(
        {
            "seed": setting.seed,
            "board": "fc",
            "pilot_plan": PilotPlan.START,
            "pilot_wait": BOOTED,
            "flight": FlightConfig(wind=WindClass.INDOOR, battery=BatteryConfig(charge=charge_of(setting.voltage))),
            "radio": {"to_board": line, "to_host": line | {"usb_timer": 0.001}},
            "scene": scene | {"light": {"noise_sd": 2.0}},
        }
    )


def charge_of(voltage: float) -> float:
    """State of charge of a pack of four cells that hovers at about a voltage [V]."""
    charges, volts = zip(*OPEN_CIRCUIT_V, strict=True)
    return max(0.01, float(np.interp(voltage / 4 + 0.1, volts, charges)))


# -- figures ----------------------------------------------------------------------------------------------------------


def figures(flown: Flown) -> dict[str, Any]:
    """What the flight was worth: errors [cm], times [s], the estimate's honesty, false warnings."""
    truth = np.array(flown.truth)
    found: dict[str, Any] = {"outcome": flown.outcome, "crashed": flown.crashed}
    found["lost"] = bool(flown.crashed) or not flown.outcome.startswith("landed on")
    ends = dict(zip(flown.parts, [*list(flown.parts.values())[1:], math.inf], strict=True))
    for part in ("hold", "light", "moderate", "follow"):
        if part in flown.parts:
            rows = _between(truth, flown.parts[part] + SETTLED, ends[part])
            if len(rows):
                found[f"{part}_cm"] = 100 * math.sqrt(float((rows[:, 1:3] ** 2).sum(axis=1).mean()))
    if "take-off" in flown.parts:
        rows = _between(truth, flown.parts["take-off"], ends["take-off"])
        found["take_off_far_cm"] = 100 * float(np.hypot(rows[:, 1], rows[:, 2]).max(initial=0.0))
    if "step" in flown.parts:
        found |= _step(_between(truth, flown.parts["step"], ends["step"]), flown.parts["step"])
    if "land" in flown.parts:
        found |= _landing(_between(truth, flown.parts["land"], math.inf))
    found |= _honesty(truth, np.array(flown.estimates), flown.parts)
    flies = flown.parts.get("hold", math.inf)
    found["false_lid"] = sum("caps ours" in text for at, text in flown.warnings if flies < at < ends.get("hold", 0.0))
    return found


def _between(rows: Array, begin: float, end: float) -> Array:
    return rows[(rows[:, 0] >= begin) & (rows[:, 0] < end)]


def _step(rows: Array, began: float) -> dict[str, Any]:
    east = rows[:, 1] + STEP / 2
    reached = np.flatnonzero(east > 0.9 * STEP)
    return {
        "step_t90": float(rows[reached[0], 0] - began) if len(reached) else math.nan,
        "step_over_percent": 100 * max(0.0, float(east.max(initial=0.0)) / STEP - 1.0),
    }


def _landing(rows: Array) -> dict[str, Any]:
    stands = np.flatnonzero(rows[:, 5] > 0)
    if not len(stands):
        return {"touch_cm": math.nan, "sink": math.nan}
    k = int(stands[0])
    return {
        "touch_cm": 100 * float(np.hypot(rows[k, 1], rows[k, 2])),
        "sink": -float(rows[max(0, k - 2), 4]),
    }


def _honesty(truth: Array, estimates: Array, parts: dict[str, float]) -> dict[str, Any]:
    """Normalised squared error of the estimated place, per axis, and what it says of the stick filter."""
    if not len(estimates):
        return {}
    flies = _between(estimates, parts.get("hold", math.inf), parts.get("land", math.inf))
    if not len(flies):
        return {}
    true = np.stack([np.interp(flies[:, 0], truth[:, 0], truth[:, 1 + axis]) for axis in range(3)], axis=1)
    errors = flies[:, 1:4] - true
    ratio = (errors / flies[:, 4:7]) ** 2
    return {
        "nees_level": float(ratio[:, :2].mean()),
        "nees_height": float(ratio[:, 2].mean()),
        "bias_height_cm": 100 * float(errors[:, 2].mean()),
        "filter_off_ms": 1000 * abs(float(flies[-1, 7]) - STICK_FILTER),
    }
