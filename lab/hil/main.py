"""`python -m lab hil`: the same scenes on simulated boards and on genuine firmware, side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import product
from typing import Final, Literal

from lab.campaign import Campaign, First, Jobs, Kept, Row, carried_out
from lab.hil import endings, generations, navicase, navipairs, rooms
from lab.hil.build import built, names
from lab.hil.flights import fly
from lab.hil.quiet import be_quiet
from lab.hil.scenes import FIGURES, FIRST_SEED, LINES, SIMULATED, setting_of, summary
from lab.hil.triggers import by_story, story_figures, tell
from lab.tables import show
from mkdaemon.cli.arguments import AsJson

Work = tuple[str, str, int]
"""Board, line, seed."""
RUNS: Final = 10
"""Flights of each board by each line, and flights in which every trigger fires."""


def main(
    *,
    firmware: str = "",
    case: Literal["scenes", "flights", "room", "paths", "triggers", "control", "navictrl", "pair"] = "scenes",
    line: Literal["both", "cable", "radio"] = "both",
    boards: Literal["both", "genuine", "simulated"] = "both",
    runs: int = RUNS,
    first: First = FIRST_SEED,
    loss: float | None = None,
    tilt: float = 0.0,
    jobs: Jobs = 2,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Fly the scenes on genuine firmware and on the simulator's boards; exit code 1 if a goal is missed.

    In virtual time, exact whatever the machine does; a flight of all scenes takes about two minutes of one core. Build
    the firmware first: `make hil FIRMWARE=<folder> SIMAVR=<folder>`.

    Args:
        firmware: Name of one that was built; the first by default.
        case: The scenes; flights, how each ended and what became of every frame; from pad to pad through a room of
            surveyed tags, or figures of eight over them; what happens when something fails,
            judged by the firmware's memory; how long it holds stick frames; a genuine NaviCtrl and the simulator's,
            side by side (`make hil NAVICTRL=<folder>`); or a genuine pair of both boards.
        line: To the boards.
        boards: Genuine, simulated, or both side by side.
        runs: Flights of each board by each line; of a pair; silences of `control`.
        loss: Of `flights`: share of the radio's packets that are lost, each way, for example 0.05.
        tilt: Of `flights`: of the pad, 0 to 20 degrees.
    """
    if case == "navictrl":
        return navicase.show(first, jobs, as_json=as_json)
    genuine, seeds = built(firmware or next(iter(names()), "FlightCtrl")).name, range(first, first + runs)
    if case == "pair":
        return navipairs.show(genuine, seeds, jobs, as_json=as_json)
    if case == "control":
        return generations.show([genuine] if firmware else names(), runs, as_json=as_json)
    if case == "triggers":
        work = [(genuine, "cable", seed) for seed in seeds]
        return _show_triggers(genuine, TRIGGERS.rows(work, jobs, results), as_json=as_json)
    flown = {"both": (genuine, SIMULATED), "genuine": (genuine,), "simulated": (SIMULATED,)}[boards]
    lines = LINES if line == "both" else (line,)
    if case == "flights":
        asked = [endings.Work(board, by, seed, loss, tilt) for seed in seeds for board, by in product(flown, lines)]
        return endings.show(ENDINGS.rows(asked, jobs, results), as_json=as_json)
    if case in {"room", "paths"}:
        through = [rooms.Work(case, board, by, seed) for seed in seeds for board, by in product(flown, lines)]
        return rooms.show(ROOMS.rows(through, jobs, results), as_json=as_json)
    work = [(board, by, seed) for seed in seeds for board, by in product(flown, lines)]
    return _show_scenes(SCENES.rows(work, jobs, results), flown, lines, as_json=as_json)


def _end_one(work: endings.Work) -> Row:
    be_quiet()
    return endings.fly(work)


def _cross_one(work: rooms.Work) -> Row:
    be_quiet()
    return rooms.fly(work)


def _fly_one(work: Work) -> Row:
    be_quiet()
    setting = setting_of(*work)
    found = fly(setting)
    about = {
        "voltage": setting.voltage,
        "heading_deg": round(math.degrees(setting.yaw)),
        "compass": setting.has_compass,
    }
    return about | found


def _tell_one(work: Work) -> Row:
    be_quiet()
    return {"stories": tell(work[0], work[2])}


def _key(work: Work) -> Row:
    board, line, seed = work
    return {"board": board, "line": line, "seed": seed}


SCENES: Final = Campaign("hil scenes", _fly_one, _key)
TRIGGERS: Final = Campaign("hil triggers", _tell_one, _key)
ROOMS: Final = Campaign("hil room", _cross_one, lambda work: work.key, limit=1200.0)
ENDINGS: Final = Campaign("hil flights", _end_one, asdict, limit=1200.0)


# -- what is shown ----------------------------------------------------------------------------------------------------


def _show_scenes(rows: Sequence[Row], boards: Sequence[str], lines: Sequence[str], *, as_json: bool) -> int:
    """Every figure of the boards side by side."""
    found, shown = carried_out(rows), list[Row]()
    for line in lines:
        summed = {
            board: summary(line, [row for row in found if (row["board"], row["line"]) == (board, line)])
            for board in boards
        }
        missed = " ".join(words for part in summed.values() for words in part["missed"])
        for figure in FIGURES:
            measured = {board: part["figures"].get(figure.key) for board, part in summed.items()}
            cells = {board: figure.shown(found) if found else "" for board, found in measured.items()}
            if any(cells.values()):
                named = {"line": line, "figure": figure.about}
                goal = {"goal": figure.goal_words(line), "holds": f"{figure.key}: " not in missed}
                shown.append(named | cells | goal)
        lost = {board: [f"{one['seed']}: {one['why']}" for one in part["lost"]] for board, part in summed.items()}
        flights = {"flights": [part["flights"] for part in summed.values()]}
        shown.append({"line": line, "figure": "lost"} | lost | flights | {"holds": not any(lost.values())})
    if len(found) < len(rows):
        shown.append({"line": "", "figure": "not flown", "flights": len(rows) - len(found), "holds": False})
    return show(shown, ("line", "figure"), as_json=as_json)


def _show_triggers(firmware: str, rows: Sequence[Row], *, as_json: bool) -> int:
    """Least / median / most of every figure of what happens, and its goal."""
    flown, shown = carried_out(rows), list[Row]()
    for name, found in by_story(flown):
        right = sum(not each["missed"] for each in found)
        figures = {figure: f"{spread}, goal {goal}" for figure, spread, goal in story_figures(name, found)}
        shown.append({"what": name, "right": right, "of": len(found)} | figures | {"holds": right == len(found)})
    if len(flown) < len(rows):
        shown.append({"what": "not flown", "of": len(rows) - len(flown), "holds": False})
    return show(shown, ("what",), as_json=as_json, firmware=firmware)
