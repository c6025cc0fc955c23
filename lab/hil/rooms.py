"""`python -m lab hil --case room` and `--case paths`: flights over a map of tags, on genuine firmware.

`room` is the flight of `mkdaemon demo --room`: take-off from one pad, 6 m over 24 surveyed tags to the other, half the
way back, a hold and a figure of eight in the middle of the room, landing. `paths` flies figures of eight of 2 x 1 m at
a mean of 1 m/s, as `python -m lab paths`. Physics and the board's memory judge.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
from pydantic import BaseModel

from lab import tables
from lab.campaign import Ending, Row, summed_up
from lab.demo import landing_of
from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from lab.hil.flights import Setting, config_of, motors_run
from lab.hil.scenes import setting_of
from lab.paths import LAPS, LIMITS, SPEED
from lab.room import STRAYED
from mkdaemon.telemetry.control import ControlError, ControlStatus
from mkdaemon.telemetry.path import PathFlown
from mkdaemon.telemetry.setpoint import LandSetpoint, PathSetpoint, TakeOffSetpoint
from mkdaemon.virtualtime import run_virtually
from mksim.config import SimConfig, WindClass
from mksim.physics.world import StartState, World
from mksim.programs.rehearsal import (
    HEIGHT,
    ROOM_FLIGHT,
    FlightPart,
    FlyingAircraft,
    over_goal,
    room_demonstration,
)
from mksim.scene.room import AWAY, GOAL, figure_of_eight
from mksim.simulation import Simulation

FPS: Final = 15.0
"""Images a second."""
EIGHTS: Final = (
    FlightPart("take-off", TakeOffSetpoint, {"height": HEIGHT, "target": GOAL}),
    FlightPart("eight", PathSetpoint, {"target": GOAL}, path=figure_of_eight(SPEED, LAPS, HEIGHT)),
    over_goal("return", 0.0, 0.0),
    FlightPart("land", LandSetpoint, {"target": GOAL}),
)
"""What `paths` flies."""
GOALS: Final = {"touch_cm": (0.9, 6.0), "eight_cm": (1.0, 10.0)}
"""Quantile of each figure, and its goal [cm]; the eight of `room` is slower, and has the same."""


@dataclass(frozen=True, slots=True)
class Work:
    """One flight.

    Attributes:
        case: `room` or `paths`.
        board: a firmware, or the simulator's boards.
        line: `cable` or `radio`.
        seed: of everything random, of what the survey left wrong, of battery, heading and compass.
        wind: class.
    """

    case: str
    board: str
    line: str
    seed: int
    wind: str = WindClass.LIGHT.value

    @property
    def key(self) -> Row:
        """Which flight it is."""
        return asdict(self)


def fly(work: Work) -> Row:
    """Fly once in virtual time.

    Returns:
        How it ended and why; `touch_cm`, `hold_cm` and `midway_cm` as in `lab.room`; `eight_cm`, root mean square of
        the horizontal distance of the true place from the one on the path.
    """
    setting = replace(setting_of(work.board, work.line, work.seed), fps=FPS)
    reasons: list[str] = []
    away: list[float] = []
    rates: list[float] = []

    def watch(_: object, status: ControlStatus | None) -> None:
        if status is not None and status.phase.value == "releasing" and not reasons:
            reasons.append(status.reason)

    async def flown() -> Row:
        config = config_of(setting)
        config = config.model_copy(update={"flight": config.flight.model_copy(update={"wind": WindClass(work.wind)})})
        is_room = work.case == "room"
        parts, limits = (ROOM_FLIGHT, {}) if is_room else (EIGHTS, LIMITS)
        aircraft = aircraft_of(setting, config)
        rehearsal = room_demonstration(config, watch, None, parts, limits=limits, aircraft=aircraft)

        def take(suffix: str, value: BaseModel) -> None:
            if isinstance(value, PathFlown):
                rates.append(value.rate if 0.0 < value.progress < 1.0 else 0.0)
            elif isinstance(value, ControlError) and value.manoeuvre == "path" and rates and rates[-1] > 0.0:
                away.append(math.dist(rehearsal.world.truth.position_enu[:2], value.goal[:2]))

        rehearsal.bus.followers.append(take)
        record = await rehearsal.fly()
        farthest = max((math.hypot(*moment.position[:2]) for moment in record.moments), default=0.0)
        stands = rehearsal.world.truth.on_ground
        row = landing_of(record, "".join(reasons), stands=stands, is_lost=farthest > STRAYED)
        if row["ending"] == Ending.FINISHED and motors_run(aircraft):
            row |= {"ending": Ending.LOST, "why": "its motors run on the ground"}
        return row | {
            "hold_cm": _rms_cm(np.hypot(*record.errors("hold")[:, :2].T)) if is_room else None,
            "midway_cm": _rms_cm(np.hypot(*record.errors("midway")[:, :2].T)) if is_room else None,
            "eight_cm": _rms_cm(np.array(away)),
        }

    return run_virtually(flown())


def aircraft_of(setting: Setting, config: SimConfig) -> FlyingAircraft:
    """What flies from the first pad: the firmware of a setting, or the simulator's boards."""
    start = StartState(east=-AWAY, yaw=setting.yaw)
    if setting.firmware is None:
        return Simulation(config, World(config.flight, seed=setting.seed, start=start))
    voltage, has_compass = setting.voltage, setting.has_compass
    return GenuineAircraft(built(setting.firmware), config, start=start, voltage=voltage, has_compass=has_compass)


def _rms_cm(errors: Any) -> float | None:
    return round(100.0 * float(np.sqrt(np.square(errors).mean())), 1) if len(errors) else None


def show(rows: Sequence[Mapping[str, Any]], *, as_json: bool) -> int:
    """Print figures of every board and line; exit code 1 unless every flight finished and each goal is reached."""
    shown = []
    for board, line in dict.fromkeys((row["board"], row["line"]) for row in rows):
        part = [dict(row) for row in rows if (row["board"], row["line"]) == (board, line)]
        found = summed_up(part, "touch_cm", "hold_cm", "midway_cm", "eight_cm", **GOALS)
        shown.append({"board": board, "line": line} | found)
    return tables.show(shown, ("board", "line", "flights"), as_json=as_json)
