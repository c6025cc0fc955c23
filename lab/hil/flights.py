"""One flight of the proving ground, on simulated boards or on genuine firmware: every scene of the table, its figures.

What would change the flight for the scenes after it (a step, another wind, a landing) is flown by a copy of everything,
firmware, air and daemon, as they are at that moment; see `lab.hil.copies`.
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
from pydantic import BaseModel

from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from lab.hil.copies import in_a_copy
from lab.hil.figures import STEP, Flown, figures
from lab.vision.lens import drawn_lens
from mkdaemon.telemetry.control import ControlEstimate, ControlStatus
from mkdaemon.telemetry.event import LogEvent
from mkdaemon.virtualtime import run_virtually
from mksim.config import BatteryConfig, FlightConfig, PilotPlan, SimConfig, WindClass
from mksim.physics.battery import OPEN_CIRCUIT_V
from mksim.physics.world import StartState, World
from mksim.programs.flightrecord import Moment
from mksim.programs.rehearsal import FlightPart, FlyingAircraft, Rehearsal, land, over_pad, take_off
from mksim.scene.camera import deck_of
from mksim.simulation import Simulation

BOOTED: Final = 8.0
"""When the pilot touches his sticks [s]: genuine boards need seven seconds to start."""
HOLD_ENDS: Final = 34.0
"""Then light wind begins [s]; step and moderate wind are flown by copies."""
LIGHT_FORKS: Final = 45.0
"""A copy lands then [s]."""
PAD_STARTS: Final = 58.0
"""The pad stands until then [s]."""
PAD_SPEED: Final = 0.5
"""Of the pad, once it moves [m/s]."""
TRUTH_PERIOD: Final = 0.01
"""[s]."""
STOPPED_WITHIN: Final = 10.0
"""Longest wait for the motors to stop after a landing [s]."""


@dataclass(frozen=True, slots=True)
class Leg:
    """A piece of the flight.

    Attributes:
        parts: of it.
        copies: what copies fly after them, by name.
    """

    parts: tuple[FlightPart, ...]
    copies: Mapping[str, tuple[FlightPart, ...]] = field(default_factory=dict)


EVERYTHING: Final = (
    Leg(
        (take_off(), over_pad("hold", 0.0, until=HOLD_ENDS)),
        {
            "step": (over_pad("aside", -STEP / 2), over_pad("wait", -STEP / 2, 2.0), over_pad("step", STEP / 2, 6.0)),
            "moderate": (over_pad("moderate", 0.0, 15.0, wind=WindClass.MODERATE),),
        },
    ),
    Leg((over_pad("light", 0.0, until=LIGHT_FORKS, wind=WindClass.LIGHT),), {"land": (land(),)}),
    Leg((over_pad("goes on", 0.0, until=PAD_STARTS + 1.0), over_pad("follow", 0.0, 7.0), land())),
)
"""Take-off and hold indoors, with a step of 1 m and moderate wind; light wind, with a landing; a pad that starts to
move, and a landing on it."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What is flown, and on what.

    Attributes:
        firmware: name of a firmware that `make hil` built; None flies the simulator's boards.
        seed: of everything random.
        is_radio: a radio instead of a cable.
        voltage: of the battery [V]; held by genuine boards, the simulator begins with it.
        has_compass: the board hears of the heading.
        yaw: at the start [rad; ENU].
        fps: images a second.
    """

    firmware: str | None
    seed: int
    is_radio: bool = False
    voltage: float = 14.8
    has_compass: bool = True
    yaw: float = math.pi / 2
    fps: float = 30.0


def fly(setting: Setting) -> dict[str, Any]:
    """Fly once in virtual time, and return the figures; see `figures`."""
    return run_virtually(_fly(setting))


async def _fly(setting: Setting) -> dict[str, Any]:
    config = config_of(setting)
    flight = SceneFlight(config, aircraft_of(setting, config), EVERYTHING)
    await flight.fly()
    return flight.found


def aircraft_of(setting: Setting, config: SimConfig) -> FlyingAircraft:
    """What flies: the firmware of a setting, or the simulator's boards."""
    deck, start = deck_of(config.scene.platform), StartState(yaw=setting.yaw)
    if setting.firmware is None:
        return Simulation(config, World(config.flight, seed=setting.seed, start=start, ground=deck))
    voltage, has_compass = setting.voltage, setting.has_compass
    firmware = built(setting.firmware)
    return GenuineAircraft(firmware, config, start=start, ground=deck, voltage=voltage, has_compass=has_compass)


class SceneFlight(Rehearsal):
    """Flies legs, and lets copies fly what would change the flight.

    The calibration of the camera is wrong, as far as its published floor says: that is a part of the estimate's doubt.

    Attributes:
        flown: what happened.
        found: its figures, and those of the copies.
    """

    def __init__(self, config: SimConfig, aircraft: FlyingAircraft, legs: Sequence[Leg]) -> None:
        """Set everything up; needs a running loop.

        Args:
            config: what is simulated.
            aircraft: boards and world, at the end of the daemon's cable.
            legs: what is flown.
        """
        rng = np.random.default_rng(config.seed)
        super().__init__(
            config, aircraft, _unwatched, moved=self._watch_truth, calibrated=lambda lens: drawn_lens(lens, rng)
        )
        self.flown, self.found = Flown(), dict[str, Any](lost=["no flight began"], warnings=[])
        self._legs, self._truth, self._kept = legs, aircraft.world.truth, -math.inf
        self._aircraft = aircraft
        self.bus.followers.append(self._hear)

    async def _fly_parts(self) -> None:
        goes_on, copies = True, dict[str, dict[str, Any]]()
        for leg in self._legs:
            goes_on = goes_on and await self._follow(leg.parts)
            for name, parts in leg.copies.items() if goes_on else ():
                copies[name] = await in_a_copy(partial(self._told, parts)) or {"lost": ["the copy died"]}
        await self._await_motors()
        self.found = self._figures(goes_on=goes_on)
        for name, told in copies.items():
            self.found["lost"] += [f"{name}: {why}" for why in told.pop("lost")]
            self.found["warnings"] += told.pop("warnings", [])
            told["unanswered_nat"] = max(self.found["unanswered_nat"], told.get("unanswered_nat", -math.inf))
            self.found |= told

    async def _told(self, parts: Sequence[FlightPart]) -> dict[str, Any]:
        """What a copy tells of parts of its own."""
        self.flown = Flown()
        goes_on = await self._follow(parts)
        await self._await_motors()
        return self._figures(goes_on=goes_on)

    async def _await_motors(self) -> None:
        """After a landing, wait until the board has stopped the motors."""
        if self._part == "land":
            await self._wait(lambda: not motors_run(self._aircraft), STOPPED_WITHIN)

    def _figures(self, *, goes_on: bool) -> dict[str, Any]:
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
        flown.truth.append((now, x, y, z, float(truth.velocity_enu[2]), float(truth.on_ground)))
        flown.unanswered = max(flown.unanswered, self._wiring.core.answer.evidence)

    def _hear(self, suffix: str, value: BaseModel) -> None:
        if isinstance(value, ControlEstimate):
            self.flown.estimates.append(
                (value.stamp.monotonic, *value.position, *value.position_sd, value.stick_filter)
            )
        elif isinstance(value, LogEvent) and value.level != "info":
            self.flown.warnings.append((value.stamp.monotonic, value.text))


def motors_run(aircraft: FlyingAircraft) -> bool:
    """Whether the board turns the motors; the firmware's memory says so where there is one."""
    if isinstance(aircraft, GenuineAircraft):
        return aircraft.world.is_armed
    assert isinstance(aircraft, Simulation)
    return aircraft.flight.core.running


def _unwatched(moment: Moment, status: ControlStatus | None) -> None:
    """Nobody looks."""


def config_of(setting: Setting) -> SimConfig:
    """What the simulator is told of a setting."""
    pad = {
        "kind": "ramp",
        "speed": PAD_SPEED,
        "acceleration": 0.25,
        "delay": PAD_STARTS,
        "heading_deg": random.Random(f"{setting.seed} pad").uniform(0.0, 360.0),
    }
    line = {"kind": "xbee"} if setting.is_radio else {"kind": "wired"}
    scene: dict[str, Any] = {"enabled": True, "fps": setting.fps, "exposure_ms": 6.0, "platform": pad}
    return SimConfig.model_validate(
        {
            "seed": setting.seed,
            "board": "fc",
            "pilot_plan": PilotPlan.START,
            "pilot_wait": BOOTED,
            "flight": FlightConfig(wind=WindClass.INDOOR, battery=battery_of(setting.voltage)),
            "radio": {"to_board": line, "to_host": line | {"usb_timer": 0.001}},
            "scene": scene | {"light": {"noise_sd": 2.0}},
        }
    )


def battery_of(voltage: float) -> BatteryConfig:
    """A pack of four cells that hovers at about a voltage [V], and is so large that no flight empties it."""
    charges, volts = zip(*OPEN_CIRCUIT_V, strict=True)
    return BatteryConfig(capacity_mah=1e6, charge=max(0.01, float(np.interp(voltage / 4 + 0.1, volts, charges))))
