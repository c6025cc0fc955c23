"""`python -m lab hil --case room` and `--case paths`: flights over a map of tags, on genuine firmware.

`room` is the flight of `mkdaemon demo --room`, `paths` flies figures of eight as `python -m lab paths`, in light wind.
Physics and the board's memory judge.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from lab import paths, room, tables
from lab.campaign import Ending, Row, summed_up
from lab.demo import flown
from lab.hil.flights import Setting, aircraft_of, config_of, motors_run
from mksim.programs.rehearsal import Rehearsal, Watcher, room_demonstration

FPS: Final = 15.0
"""Images a second."""
GOALS: Final = {
    "room": {"touch_cm": (0.9, room.GOAL_P90_CM), "eight_cm": (1.0, paths.GOAL_RMS_CM)},
    "paths": {"touch_cm": (0.9, room.GOAL_P90_CM), "rms_cm": (1.0, paths.GOAL_RMS_CM)},
}
"""Of each case: which share of the flights does not exceed what."""
FIGURES: Final = {"room": ("touch_cm", "hold_cm", "midway_cm", "eight_cm"), "paths": ("touch_cm", "rms_cm", "most_cm")}


def fly(case: str, setting: Setting) -> Row:
    """Fly once in virtual time; the figures of `lab.room` or `lab.paths`. Motors that run on the ground are lost."""
    config = config_of(setting)
    aircraft, followed = aircraft_of(setting, config, is_room=True), paths.Followed()

    def prepare(watch: Watcher) -> Rehearsal:
        if case == "room":
            return room_demonstration(config, watch, aircraft=aircraft)
        flight = room_demonstration(config, watch, None, paths.eights(), limits=paths.LIMITS, aircraft=aircraft)
        return followed.attached(flight)

    record, row = flown(prepare, room.STRAYED)
    if row["ending"] == Ending.FINISHED and motors_run(aircraft):
        return row | {"ending": Ending.LOST, "why": "its motors run on the ground"}
    return room.judged(row, record) if case == "room" else followed.judged(row)


def show(rows: Sequence[Row], *, as_json: bool) -> int:
    """Print figures of every board and line; exit code 1 unless every flight finished and each goal is reached."""
    shown = []
    for case, board, line in dict.fromkeys((row["case"], row["board"], row["line"]) for row in rows):
        part = [row for row in rows if (row["board"], row["line"]) == (board, line)]
        shown.append({"board": board, "line": line} | summed_up(part, *FIGURES[case], **GOALS[case]))
    return tables.show(shown, ("board", "line", "flights"), as_json=as_json)
