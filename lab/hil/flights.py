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
import numpy.typing as npt
from pydantic import BaseModel

from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from lab.hil.copies import in_a_copy
from lab.vision.lens import drawn_lens
from mkdaemon.control.estimator.model import STICK_FILTER
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

Array = npt.NDArray[np.float64]

BOOTED: Final = 8.0
"""When the pilot touches his sticks [s]: genuine boards need seven seconds to start."""
SETTLED: Final = 5.0
"""Figures of a hold are taken after this [s]."""
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
STEP: Final = 1.0
"""Length of the step [m]."""
ON_TARGET: Final = 0.3
"""An aircraft this far from the middle of the target, or nearer, has landed on it [m]."""
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


@dataclass(slots=True)
class Flown:
    """What happened.

    Attributes:
        truth: time [s], true position in the frame of the target (3) [m], vertical speed [m/s], 1 on the ground.
        estimates: of every estimate: time [s], position (3) [m], standard deviations (3) [m], stick filter [s].
        warnings: of the daemon, with their times [s].
        parts: begin of each [s].
        unanswered: largest evidence that the aircraft does not answer its sticks [nat].
        end: why the flight ended.
        crashed: why the aircraft broke; empty while whole.
        motors_run: whether the board turned the motors at the end.
    """

    truth: list[tuple[float, ...]] = field(default_factory=list)
    estimates: list[tuple[float, ...]] = field(default_factory=list)
    warnings: list[tuple[float, str]] = field(default_factory=list)
    parts: dict[str, float] = field(default_factory=dict)
    unanswered: float = -math.inf
    end: str = ""
    crashed: str = ""
    motors_run: bool = False


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


# -- figures ----------------------------------------------------------------------------------------------------------


def figures(flown: Flown) -> dict[str, Any]:
    """What a flight, or a copy of one, was worth: errors [cm], times [s], the estimate's honesty, what it warned of.

    A part that was not flown has no figures. `lost` says why an aircraft was lost, or did not do what it was to do.
    """
    truth, parts = np.array(flown.truth).reshape(-1, 6), flown.parts
    found: dict[str, Any] = {"lost": _lost(flown, truth), "unanswered_nat": round(flown.unanswered, 3)}
    found["warnings"] = [text for at, text in flown.warnings if at >= parts.get("take-off", 0.0)]
    if "take-off" in parts:
        rows = _between(truth, parts["take-off"], parts.get("hold", math.inf))
        found["take_off_far_cm"] = 100 * float(np.hypot(rows[:, 1], rows[:, 2]).max(initial=0.0))
    for part, end in (("hold", "light"), ("light", "follow"), ("moderate", ""), ("follow", "land")):
        rows = _between(truth, parts.get(part, math.inf) + SETTLED, parts.get(end, math.inf))
        if len(rows):
            found[f"{part}_cm"] = 100 * math.sqrt(float((rows[:, 1:3] ** 2).sum(axis=1).mean()))
    if "step" in parts:
        found |= _step(_between(truth, parts["step"], math.inf), parts["step"])
        if "step_t90" not in found:
            found["lost"].append("nine tenths of the step were never reached")
    if "land" in parts:
        on = "moving_" if "follow" in parts else ""
        found |= {on + key: value for key, value in _landing(_between(truth, parts["land"], math.inf)).items()}
    if "hold" in parts:
        found |= _honesty(truth, np.array(flown.estimates), parts)
    return found


def _lost(flown: Flown, truth: Array) -> list[str]:
    """Why the aircraft was lost, or did not do what it was to do; physics and the board say so, not the daemon."""
    if flown.crashed:
        return [flown.crashed]
    if list(flown.parts)[-1:] != ["land"]:
        return [flown.end] if flown.end else []
    return not_landed(_between(truth, flown.parts["land"], math.inf), flown.end, motors_run=flown.motors_run)


def not_landed(rows: Array, end: str, *, motors_run: bool) -> list[str]:
    """What is missing of a landing on the target.

    Args:
        rows: truth from the begin of the landing to the end of the flight; see `Flown.truth`.
        end: why the daemon ended the flight.
        motors_run: whether the board turns the motors at the end.

    Returns:
        Reasons; none where the aircraft stands on the target with its motors off.
    """
    if not len(rows) or not rows[-1, 5]:
        return [f"it did not land: {end or 'it is in the air at the end'}"]
    off = float(np.hypot(rows[-1, 1], rows[-1, 2]))
    found = [f"it stands {100 * off:.0f} cm from the middle of the target"] if off > ON_TARGET else []
    return found + (["its motors run on the ground"] if motors_run else [])


def _between(rows: Array, begin: float, end: float) -> Array:
    return rows[(rows[:, 0] >= begin) & (rows[:, 0] < end)]


def _step(rows: Array, began: float) -> dict[str, Any]:
    east = rows[:, 1] + STEP / 2
    reached = np.flatnonzero(east > 0.9 * STEP)
    found = {"step_over_percent": 100 * max(0.0, float(east.max(initial=0.0)) / STEP - 1.0)}
    return found | ({"step_t90": float(rows[reached[0], 0] - began)} if len(reached) else {})


def _landing(rows: Array) -> dict[str, Any]:
    stands = np.flatnonzero(rows[:, 5] > 0)
    if not len(stands):
        return {}
    k = int(stands[0])
    return {
        "touch_cm": 100 * float(np.hypot(rows[k, 1], rows[k, 2])),
        "sink": -float(rows[max(0, k - 2), 4]),
    }


def _honesty(truth: Array, estimates: Array, parts: Mapping[str, float]) -> dict[str, Any]:
    """Normalised squared error of the estimated place, per axis, and what it says of the stick filter."""
    flies = _between(estimates.reshape(-1, 8), parts["hold"], parts.get("land", math.inf))
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
