"""`python -m lab hil --case room` and `--case paths`: flights over a map of tags, on genuine firmware.

`room` is the flight of `mkdaemon demo --room`: take-off from one pad, 6 m over 24 surveyed tags to the other, half the
way back, a hold and a figure of eight in the middle of the room, landing. `paths` flies figures of eight of 2 x 1 m at
a mean of 1 m/s, as `python -m lab paths`. Physics and the board's memory judge.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

from lab import paths, room, tables
from lab.campaign import Ending, Row, summed_up
from lab.demo import flown
from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from lab.hil.flights import Setting, config_of, motors_run
from lab.hil.scenes import setting_of
from mksim.config import SimConfig, WindClass
from mksim.physics.world import StartState, World
from mksim.programs.rehearsal import FlyingAircraft, Rehearsal, Watcher, room_demonstration
from mksim.scene.room import AWAY
from mksim.simulation import Simulation

FPS: Final = 15.0
"""Images a second."""
FIGURES: Final = {"room": ("touch_cm", "hold_cm", "midway_cm", "eight_cm"), "paths": ("touch_cm", "rms_cm", "most_cm")}
GOALS: Final = {
    "room": {"touch_cm": (0.9, room.GOAL_P90_CM), "eight_cm": (1.0, paths.GOAL_RMS_CM)},
    "paths": {"touch_cm": (0.9, room.GOAL_P90_CM), "rms_cm": (1.0, paths.GOAL_RMS_CM)},
}
"""Of each case: which share of the flights does not exceed what."""


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
        The figures of `lab.room` or of `lab.paths`. A board whose motors run on the ground is lost.
    """
    setting = replace(setting_of(work.board, work.line, work.seed), fps=FPS)
    config = config_of(setting)
    config = config.model_copy(update={"flight": config.flight.model_copy(update={"wind": WindClass(work.wind)})})
    aircraft, followed = aircraft_of(setting, config), paths.Followed()

    def prepare(watch: Watcher) -> Rehearsal:
        if work.case == "room":
            return room_demonstration(config, watch, aircraft=aircraft)
        eights = paths.eights()
        return followed.attached(
            room_demonstration(config, watch, None, eights, limits=paths.LIMITS, aircraft=aircraft)
        )

    record, row = flown(prepare, room.STRAYED)
    if row["ending"] == Ending.FINISHED and motors_run(aircraft):
        return row | {"ending": Ending.LOST, "why": "its motors run on the ground"}
    return row | room.figures_of(record) if work.case == "room" else followed.judged(row)


def aircraft_of(setting: Setting, config: SimConfig) -> FlyingAircraft:
    """What flies from the first pad: the firmware of a setting, or the simulator's boards."""
    start = StartState(east=-AWAY, yaw=setting.yaw)
    if setting.firmware is None:
        return Simulation(config, World(config.flight, seed=setting.seed, start=start))
    voltage, has_compass = setting.voltage, setting.has_compass
    return GenuineAircraft(built(setting.firmware), config, start=start, voltage=voltage, has_compass=has_compass)


def show(rows: Sequence[Mapping[str, Any]], *, as_json: bool) -> int:
    """Print figures of every board and line; exit code 1 unless every flight finished and each goal is reached."""
    shown = []
    for case, board, line in dict.fromkeys((row["case"], row["board"], row["line"]) for row in rows):
        part = [dict(row) for row in rows if (row["board"], row["line"]) == (board, line)]
        shown.append({"board": board, "line": line} | summed_up(part, *FIGURES[case], **GOALS[case]))
    return tables.show(shown, ("board", "line", "flights"), as_json=as_json)
