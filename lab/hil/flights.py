"""Flights of genuine firmware, or of the simulator's boards, by the whole daemon with the rendered camera.

What would change a flight for the parts after it (a step, another wind, a landing) is flown by a copy of everything,
firmware, air and daemon, as they are at that moment; see `in_a_copy`.
"""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

from lab.campaign import Row
from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from lab.hil.processes import in_a_copy
from lab.vision.lens import drawn_lens
from mkdaemon.telemetry.control import ControlEstimate, ControlStatus
from mkdaemon.telemetry.event import LogEvent
from mksim.config import BatteryConfig, FlightConfig, PilotPlan, SimConfig, WindClass
from mksim.physics.battery import OPEN_CIRCUIT_V
from mksim.physics.world import StartState, World
from mksim.programs.rehearsal import FlightPart, FlyingAircraft, Rehearsal
from mksim.scene.camera import DECK_RADIUS_M, deck_of
from mksim.scene.room import AWAY
from mksim.simulation import Simulation

Array = npt.NDArray[np.float64]

SETTLED: Final = 5.0
"""Figures of a hold are taken after this [s]."""
STEP: Final = 1.0
"""Length of the step [m]."""
ON_TARGET: Final = 0.3
"""An aircraft this far from the middle of the target, or nearer, has landed on it [m]."""


@dataclass(slots=True)
class Flown:
    """What happened.

    Attributes:
        truth: time [s], true position in the frame of the target (3) [m], 1 on the ground.
        estimates: of every estimate: time [s], position (3) [m], standard deviations (3) [m].
        warnings: of the daemon, with their times [s].
        parts: begin of each [s].
        end: why the flight ended.
        crashed: why the aircraft broke; empty while whole.
        motors_run: whether the board turned the motors at the end.
    """

    truth: list[tuple[float, ...]] = field(default_factory=list)
    estimates: list[tuple[float, ...]] = field(default_factory=list)
    warnings: list[tuple[float, str]] = field(default_factory=list)
    parts: dict[str, float] = field(default_factory=dict)
    end: str = ""
    crashed: str = ""
    motors_run: bool = False

    def rows(self, begin: float = -math.inf, end: float = math.inf) -> Array:
        """The truth of a time [s] (n, 5)."""
        rows = np.array(self.truth).reshape(-1, 5)
        return rows[(rows[:, 0] >= begin) & (rows[:, 0] < end)]

    def began(self, part: str) -> float:
        """When a part began [s]; infinite where it was not flown."""
        return self.parts.get(part, math.inf)


def figures(flown: Flown) -> Row:
    """What a flight, or a copy of one, was worth: errors [cm], times [s], the estimate's honesty, what it warned of.

    A part that was not flown has no figures. `lost` says why an aircraft was lost, or did not do what it was to do.
    """
    parts, began = flown.parts, flown.began
    found: Row = {"lost": _lost(flown)}
    found["warnings"] = [text for at, text in flown.warnings if at >= parts.get("take-off", 0.0)]
    for part, end in (("hold", "light"), ("light", "follow"), ("moderate", "")):
        rows = flown.rows(began(part) + SETTLED, began(end))
        if len(rows):
            found[f"{part}_cm"] = 100 * math.sqrt(float((rows[:, 1:3] ** 2).sum(axis=1).mean()))
    if "step" in parts:
        rows = flown.rows(began("step"))
        east = rows[:, 1] + STEP / 2
        reached = np.flatnonzero(east > 0.9 * STEP)
        found["step_over_percent"] = 100 * max(0.0, float(east.max(initial=0.0)) / STEP - 1.0)
        if len(reached):
            found["step_t90"] = float(rows[reached[0], 0] - began("step"))
        else:
            found["lost"].append("nine tenths of the step were never reached")
    rows = flown.rows(began("land"))
    if (rows[:, 4] > 0).any():
        first = rows[rows[:, 4] > 0][0]
        found["moving_touch_cm" if "follow" in parts else "touch_cm"] = 100 * math.hypot(first[1], first[2])
    return found | (_honesty(flown) if "hold" in parts else {})


def _lost(flown: Flown) -> list[str]:
    """Why the aircraft was lost, or did not do what it was to do; physics and the board say so, not the daemon."""
    if flown.crashed:
        return [flown.crashed]
    if list(flown.parts)[-1:] != ["land"]:
        return [flown.end] if flown.end else []
    rows = flown.rows(flown.began("land"))
    if not len(rows) or not rows[-1, 4]:
        return [f"it did not land: {flown.end or 'it is in the air at the end'}"]
    off = math.hypot(rows[-1, 1], rows[-1, 2])
    found = [f"it stands {100 * off:.0f} cm from the middle of the target"] if off > ON_TARGET else []
    return found + (["its motors run on the ground"] if flown.motors_run else [])


def _honesty(flown: Flown) -> Row:
    """Normalised squared error of the estimated place, per axis."""
    truth, estimates = flown.rows(), np.array(flown.estimates).reshape(-1, 7)
    flies = estimates[(estimates[:, 0] >= flown.began("hold")) & (estimates[:, 0] < flown.began("land"))]
    if not len(flies):
        return {}
    true = np.stack([np.interp(flies[:, 0], truth[:, 0], truth[:, 1 + axis]) for axis in range(3)], axis=1)
    ratio = ((flies[:, 1:4] - true) / flies[:, 4:7]) ** 2
    return {
        "nees_level": float(ratio[:, :2].mean()),
        "nees_height": float(ratio[:, 2].mean()),
    }


SIMULATED: Final = "simulated"
"""The simulator's boards, in place of a firmware's name."""
VOLTAGES: Final = (13.4, 13.6, 14.8, 15.6, 16.4, 16.8)
"""Of the battery, one for each seed [V]; with less the low battery ends every flight."""
BOOTED: Final = 8.0
"""When the pilot touches his sticks [s]: genuine boards need seven seconds to start."""
PAD_STARTS: Final = 58.0
"""The pad stands until then [s]."""
PAD_SPEED: Final = 0.5
"""Of the pad, once it moves [m/s]."""
TRUTH_PERIOD: Final = 0.01
"""[s]."""
STOPPED_WITHIN: Final = 10.0
"""Longest wait for the motors to stop after a landing [s]."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What is flown, and on what.

    Attributes:
        board: name of a firmware that `make hil` built, or `SIMULATED`.
        seed: of everything random.
        is_radio: a radio instead of a cable.
        voltage: of the battery [V]; held by genuine boards, the simulator begins with it.
        has_compass: the board hears of the heading.
        yaw: at the start [rad; ENU].
        fps: images a second.
        wind: at the start.
        loss: share of the radio's packets that are lost, each way; None for the radio's default.
        tilt_deg: of a pad that stays at rest [deg]; None for one that moves from `PAD_STARTS` on.
    """

    board: str
    seed: int
    is_radio: bool = False
    voltage: float = 14.8
    has_compass: bool = True
    yaw: float = math.pi / 2
    fps: float = 30.0
    wind: WindClass = WindClass.INDOOR
    loss: float | None = None
    tilt_deg: float | None = None


def setting_of(board: str, line: str, seed: int, **more: Any) -> Setting:
    """The setting of a seed: every flight another battery, another heading, with a compass or without."""
    rng = random.Random(f"{seed} setting")
    voltage, yaw = rng.choice(VOLTAGES), rng.uniform(-math.pi, math.pi)
    is_radio, has_compass = line == "radio", rng.random() < 0.7
    return Setting(board, seed, is_radio, voltage, has_compass, yaw, **more)


def config_of(setting: Setting) -> SimConfig:
    """What the simulator is told of a setting."""
    if setting.tilt_deg is None:
        heading = random.Random(f"{setting.seed} pad").uniform(0.0, 360.0)
        pad: Row = {"kind": "ramp", "speed": PAD_SPEED, "acceleration": 0.25, "delay": PAD_STARTS}
        pad |= {"heading_deg": heading}
    else:
        height = DECK_RADIUS_M * math.tan(math.radians(setting.tilt_deg))
        pad = {"start_enu": (0.0, 0.0, height), "tilt_deg": setting.tilt_deg}
    line: Row = {"kind": "xbee"} if setting.is_radio else {"kind": "wired"}
    if setting.loss is not None:
        line["loss"] = setting.loss
    scene: Row = {"enabled": True, "fps": setting.fps, "exposure_ms": 6.0, "platform": pad}
    # four cells that hover at about the voltage, so large that no flight empties them
    charges, volts = zip(*OPEN_CIRCUIT_V, strict=True)
    charge = max(0.01, float(np.interp(setting.voltage / 4 + 0.1, volts, charges)))
    return SimConfig.model_validate(
        {
            "seed": setting.seed,
            "board": "fc",
            "pilot_plan": PilotPlan.START,
            "pilot_wait": BOOTED,
            "flight": FlightConfig(wind=setting.wind, battery=BatteryConfig(capacity_mah=1e6, charge=charge)),
            "radio": {"to_board": line, "to_host": line | {"usb_timer": 0.001}},
            "scene": scene | {"light": {"noise_sd": 2.0}},
        }
    )


def aircraft_of(setting: Setting, config: SimConfig, *, is_room: bool = False) -> FlyingAircraft:
    """What flies, from the pad or from the first pad of a room: a firmware, or the simulator's boards."""
    start = StartState(east=-AWAY, yaw=setting.yaw) if is_room else StartState(yaw=setting.yaw)
    ground = None if is_room else deck_of(config.scene.platform)
    if setting.board == SIMULATED:
        return Simulation(config, World(config.flight, seed=setting.seed, start=start, ground=ground))
    more: Row = {"voltage": setting.voltage, "has_compass": setting.has_compass}
    return GenuineAircraft(built(setting.board), config, start=start, ground=ground, **more)


def motors_run(aircraft: FlyingAircraft) -> bool:
    """Whether the board turns the motors; the firmware's memory says so where there is one."""
    if isinstance(aircraft, GenuineAircraft):
        return aircraft.world.is_armed
    assert isinstance(aircraft, Simulation)
    return aircraft.flight.core.running


@dataclass(frozen=True, slots=True)
class Leg:
    """A piece of the flight.

    Attributes:
        parts: of it.
        copies: what copies fly after them, by name.
    """

    parts: tuple[FlightPart, ...]
    copies: Mapping[str, tuple[FlightPart, ...]] = field(default_factory=dict)


class SceneFlight(Rehearsal):
    """Flies legs, and lets copies fly what would change the flight.

    The calibration of the camera is wrong, as far as its published floor says: that is a part of the estimate's doubt.

    Attributes:
        flown: what happened.
        found: its figures, and those of the copies.
    """

    def __init__(self, config: SimConfig, aircraft: FlyingAircraft, legs: Sequence[Leg]) -> None:
        """Set everything up; needs a running loop."""
        rng = np.random.default_rng(config.seed)
        super().__init__(
            config,
            aircraft,
            lambda moment, status: None,
            moved=self._watch_truth,
            calibrated=lambda lens: drawn_lens(lens, rng),
        )
        self.flown, self.found = Flown(), Row(lost=["no flight began"], warnings=[])
        self._legs, self._truth, self._kept = legs, aircraft.world.truth, -math.inf
        self._aircraft = aircraft
        self.bus.followers.append(self._value_published)

    async def _fly_parts(self) -> None:
        goes_on, copies = True, dict[str, Row]()
        for leg in self._legs:
            goes_on = goes_on and await self._follow(leg.parts)
            for name, parts in leg.copies.items() if goes_on else ():
                copies[name] = await in_a_copy(partial(self._fly_copy, parts)) or {"lost": ["the copy died"]}
        self.found = await self._figures(goes_on=goes_on)
        for name, found in copies.items():
            self.found["lost"] += [f"{name}: {why}" for why in found.pop("lost")]
            self.found["warnings"] += found.pop("warnings", [])
            self.found |= found

    async def _fly_copy(self, parts: Sequence[FlightPart]) -> Row:
        """The figures of parts that a copy flies."""
        self.flown = Flown()
        return await self._figures(goes_on=await self._follow(parts))

    async def _figures(self, *, goes_on: bool) -> Row:
        """The figures; after a landing, once the board has stopped the motors."""
        if self._part == "land":
            await self._wait(lambda: not motors_run(self._aircraft), STOPPED_WITHIN)
        status, flown = self._value("control/status", ControlStatus), self.flown
        flown.end = "" if goes_on or status is None else status.reason
        flown.crashed = self._truth.crash_reason
        flown.motors_run = motors_run(self._aircraft)
        return figures(flown)

    def _begin(self, part: str) -> None:
        super()._begin(part)
        self.flown.parts[part] = asyncio.get_running_loop().time()

    def _watch_truth(self, now: float) -> None:
        if now - self._kept < TRUTH_PERIOD - 1e-9:
            return
        self._kept, flown, truth = now, self.flown, self._truth
        pad = self._scene.platform.pose_at(now)
        x, y, z = (float(part) for part in pad.enu_from_body.T @ (truth.position_enu - pad.position_enu))
        flown.truth.append((now, x, y, z, float(truth.on_ground)))

    def _value_published(self, suffix: str, value: BaseModel) -> None:
        if isinstance(value, ControlEstimate):
            self.flown.estimates.append((value.stamp.monotonic, *value.position, *value.position_sd))
        elif isinstance(value, LogEvent) and value.level != "info":
            self.flown.warnings.append((value.stamp.monotonic, value.text))
