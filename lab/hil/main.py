"""`python -m lab hil`: the same scenes on simulated boards and on genuine firmware, side by side."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Final, Literal

from rich.table import Table

from lab.campaign import Campaign, Row, carried_out
from lab.hil import endings, generations, navicase, navipairs
from lab.hil.build import built, names
from lab.hil.flights import fly
from lab.hil.quiet import be_quiet
from lab.hil.scenes import FIGURES, FIRST_SEED, LINES, SIMULATED, setting_of, summary
from lab.hil.triggers import by_story, story_figures, tell
from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.console import Console
from mkdaemon.errors import ConfigError

Work = tuple[str, str, int]
"""Board, line, seed."""
RUNS: Final = 10
"""Flights of each board by each line, and flights in which every trigger fires."""


def main(
    *,
    firmware: str = "",
    case: Literal["scenes", "flights", "triggers", "control", "navictrl", "pair"] = "scenes",
    line: Literal["both", "cable", "radio"] = "both",
    boards: Literal["both", "genuine", "simulated"] = "both",
    runs: int = RUNS,
    first_seed: int = FIRST_SEED,
    loss: float | None = None,
    tilt: float = 0.0,
    jobs: int = 2,
    results: Path | None = None,
    as_json: AsJson = False,
) -> int:
    """Fly the scenes on genuine firmware and on the simulator's boards; exit code 1 if a goal is missed.

    In virtual time, exact whatever the machine does; a flight of all scenes takes about two minutes of one core. Build
    the firmware first: `make hil FIRMWARE=<folder> SIMAVR=<folder>`.

    Args:
        firmware: Name of one that was built; the first by default.
        case: The scenes; flights, how each ended and what became of every frame; what happens when something fails,
            judged by the firmware's memory; how long it holds stick frames; a genuine NaviCtrl and the simulator's,
            side by side (`make hil NAVICTRL=<folder>`); or a genuine pair of both boards.
        line: To the boards.
        boards: Genuine, simulated, or both side by side.
        runs: Flights of each board by each line; of a pair; silences of `control`.
        first_seed: Seeds count up from here.
        loss: Of `flights`: share of the radio's packets that are lost, each way, for example 0.05.
        tilt: Of `flights`: of the pad, 0 to 20 degrees.
        jobs: Processes.
        results: File in which every flight is kept as it ends; flights that are in it are not flown again.
        as_json: Print JSON, one object a line, in place of a table.
    """
    try:
        if case == "navictrl":
            return navicase.show(first_seed, jobs, as_json=as_json)
        genuine = built(firmware or next(iter(names()), "FlightCtrl")).name
        if case == "pair":
            return navipairs.show(genuine, range(first_seed, first_seed + runs), jobs, as_json=as_json)
        if case == "control":
            return generations.show([genuine] if firmware else names(), runs, as_json=as_json)
    except ConfigError as error:
        print(f"lab hil: {error}", file=sys.stderr)
        return 2
    seeds = range(first_seed, first_seed + runs)
    if case == "triggers":
        work = [(genuine, "cable", seed) for seed in seeds]
        return _show_triggers(genuine, TRIGGERS.rows(work, jobs, results), as_json=as_json)
    flown = {"both": (genuine, SIMULATED), "genuine": (genuine,), "simulated": (SIMULATED,)}[boards]
    lines = LINES if line == "both" else (line,)
    if case == "flights":
        asked = [endings.Work(board, by, seed, loss, tilt) for seed in seeds for board, by in product(flown, lines)]
        return endings.show(ENDINGS.rows(asked, jobs, results), flown, lines, as_json=as_json)
    work = [(board, by, seed) for seed in seeds for board, by in product(flown, lines)]
    return _show_scenes(SCENES.rows(work, jobs, results), flown, lines, as_json=as_json)


def _end_one(work: endings.Work) -> Row:
    be_quiet()
    return endings.fly(work)


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
ENDINGS: Final = Campaign("hil flights", _end_one, lambda work: work.key, limit=1200.0)


# -- what is shown ----------------------------------------------------------------------------------------------------


def _show_scenes(rows: Sequence[Row], boards: Sequence[str], lines: Sequence[str], *, as_json: bool) -> int:
    holds = len(carried_out(rows)) == len(rows)
    rows = carried_out(rows)
    for line in lines:
        summed = {
            board: summary(line, [row for row in rows if (row["board"], row["line"]) == (board, line)])
            for board in boards
        }
        holds &= not any(part["missed"] or part["lost"] for part in summed.values())
        if as_json:
            print(json.dumps({"line": line, "boards": summed}), flush=True)
        else:
            Console().print(_table(line, summed))
    return 0 if holds else 1


def _table(line: str, boards: Mapping[str, Any]) -> Table:
    table = Table("figure", *boards, "goal", title=f"by {line}: median / p90 / worst (mean)")
    for figure in FIGURES:
        cells = [_cell(part["figures"].get(figure.key), figure.digits) for part in boards.values()]
        if any(cells):
            table.add_row(figure.about, *cells, figure.goal_words(line))
    table.add_row("lost", *(f"{len(part['lost'])} of {part['flights']}" for part in boards.values()), "0")
    return table


def _cell(figure: Mapping[str, float] | None, digits: int) -> str:
    if figure is None:
        return ""
    shown = " / ".join(f"{figure[of]:.{digits}f}" for of in ("median", "p90", "worst"))
    return f"{shown} ({figure['mean']:.{digits}f})"


def _show_triggers(firmware: str, rows: Sequence[Row], *, as_json: bool) -> int:
    table = Table("what happens", "figure", "least / median / most", "goal", "right", title=f"triggers on {firmware}")
    holds = len(carried_out(rows)) == len(rows)
    for name, found in by_story(carried_out(rows)):
        right = sum(not each["missed"] for each in found)
        holds &= right == len(found)
        if as_json:
            print(json.dumps({"story": name, "right": right, "of": len(found), "flights": found}), flush=True)
        for figure, shown, goal in story_figures(name, found):
            table.add_row(name, figure, shown, goal, f"{right} of {len(found)}")
    if not as_json:
        Console().print(table)
    return 0 if holds else 1
