"""`python -m lab hil`: the same scenes on simulated boards and on genuine firmware, side by side."""

from __future__ import annotations

import json
import logging
import multiprocessing
import statistics
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Final, Literal

import numpy as np
import structlog
from rich.table import Table

from lab.hil.build import built, names
from lab.hil.flights import fly
from lab.hil.scenes import FIRST_SEED, SCENES, Goal, Scene
from lab.hil.triggers import STORIES, tell
from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.console import Console
from mkdaemon.errors import ConfigError

SIMULATED: Final = "simulated"
"""The simulator's boards, in a table."""
TRIGGER_RUNS: Final = 10
"""Flights in which every trigger fires."""
SHOWN: Final = (
    "hold_cm",
    "light_cm",
    "moderate_cm",
    "follow_cm",
    "step_t90",
    "step_over_percent",
    "take_off_far_cm",
    "touch_cm",
    "sink",
    "nees_level",
    "nees_height",
    "filter_off_ms",
    "false_lid",
)
"""Figures in the order of the table."""


def main(
    *,
    firmware: str = "",
    case: Literal["scenes", "triggers"] = "scenes",
    scene: Literal["", "cable", "radio", "moving", "voltages", "headings"] = "",
    runs: int | None = None,
    first_seed: int = FIRST_SEED,
    boards: Literal["both", "genuine", "simulated"] = "both",
    jobs: int = 2,
    as_json: AsJson = False,
) -> int:
    """Fly the scenes on genuine firmware and on the simulator's boards; exit code 1 if a goal is missed.

    In virtual time, exact whatever the machine does; a flight takes about its own time of one core. Build the
    firmware first: `make hil FIRMWARE=<folder> SIMAVR=<folder>`.

    Args:
        firmware: Name of one that was built; the first by default.
        case: The scenes, or what happens when something fails, judged by the firmware's memory.
        scene: One scene instead of all.
        runs: Flights of every scene, in place of each scene's own.
        first_seed: Seeds count up from here.
        boards: Genuine, simulated, or both side by side.
        jobs: Processes.
        as_json: Print JSON, one object a line, in place of a table.
    """
    try:
        genuine = built(firmware or next(iter(names()), "FlightCtrl")).name
    except ConfigError as error:
        print(f"lab hil: {error}", file=sys.stderr)
        return 2
    if case == "triggers":
        return _tell_triggers(genuine, runs or TRIGGER_RUNS, first_seed, jobs, as_json=as_json)
    flown = {"both": (None, genuine), "genuine": (genuine,), "simulated": (None,)}[boards]
    holds = True
    for name in [scene] if scene else SCENES:
        columns = {board or SIMULATED: _fly(name, board, runs, first_seed, jobs) for board in flown}
        summed = {board: summary(SCENES[name], found) for board, found in columns.items()}
        holds &= all(part["holds"] for part in summed.values())
        if as_json:
            print(json.dumps({"scene": name, "boards": summed}), flush=True)
        else:
            Console().print(_table(SCENES[name], summed))
    return 0 if holds else 1


def _tell_triggers(firmware: str, runs: int, first_seed: int, jobs: int, *, as_json: bool) -> int:
    """Let every trigger fire, in so many flights; exit code 1 if one misses its goals."""
    work = [(firmware, first_seed + k) for k in range(runs)]
    flights = []
    with ProcessPoolExecutor(min(jobs, runs), multiprocessing.get_context("spawn")) as pool:
        for told in pool.map(_tell_one, work):
            flights.append(told)
            print(f"triggers: {len(flights)} of {runs} flights", file=sys.stderr, flush=True)
    table = Table("what happens", "figure", "least / median / most", "goal", "right", title=f"triggers on {firmware}")
    holds = True
    for name in dict.fromkeys(name for flight in flights for name in flight):
        found = [flight[name] for flight in flights if name in flight]
        right = sum(not each["missed"] for each in found)
        holds &= right == len(found)
        if as_json:
            print(json.dumps({"story": name, "right": right, "of": len(found), "flights": found}), flush=True)
        for figure in [key for key in found[0] if key != "missed"]:
            values = sorted(each[figure] for each in found if figure in each)
            shown = f"{values[0]:.2f} / {statistics.median(values):.2f} / {values[-1]:.2f}"
            goal = STORIES[name].goals.get(figure)
            words = "" if goal is None else f"{goal[0]:g} to {goal[1]:g}"
            table.add_row(name, figure, shown, words, f"{right} of {len(found)}")
    if not as_json:
        Console().print(table)
    return 0 if holds else 1


def _tell_one(work: tuple[str, int]) -> dict[str, dict[str, Any]]:
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    return tell(*work)


def _fly(name: str, board: str | None, runs: int | None, first_seed: int, jobs: int) -> list[dict[str, Any]]:
    count = runs or SCENES[name].flights
    work = [(name, board, first_seed + k) for k in range(count)]
    found = []
    with ProcessPoolExecutor(min(jobs, count), multiprocessing.get_context("spawn")) as pool:
        for result in pool.map(_fly_one, work):
            found.append(result)
            print(f"{name}, {board or SIMULATED}: {len(found)} of {count} flights", file=sys.stderr, flush=True)
    return found


def _fly_one(work: tuple[str, str | None, int]) -> dict[str, Any]:
    name, board, seed = work
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    return fly(SCENES[name].setting(board, seed)) | {"seed": seed}


def summary(scene: Scene, flights: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Median, 90th percentile and worst of every figure, who was lost, and which goals are missed.

    Args:
        scene: that was flown.
        flights: figures of each flight; see `lab.hil.flights.figures`.
    """
    figures = {}
    for key in SHOWN:
        values = [float(flight[key]) for flight in flights if key in flight and not np.isnan(flight[key])]
        if values:
            figures[key] = {
                "median": round(statistics.median(values), 2),
                "p90": round(float(np.percentile(values, 90)), 2),
                "worst": round(max(values), 2),
            }
    missed = [_words(key, goal) for key, goal in scene.goals if key not in figures or figures[key][goal.of] > goal.most]
    lost = [
        {"seed": flight["seed"], "why": flight["crashed"] or flight["outcome"]} for flight in flights if flight["lost"]
    ]
    return {
        "flights": len(flights),
        "lost": lost,
        "figures": figures,
        "missed": missed,
        "holds": not missed and not lost,
    }


def _words(key: str, goal: Goal) -> str:
    return f"{key}: {goal.of} at most {goal.most:g}"


def _table(scene: Scene, boards: dict[str, Any]) -> Table:
    table = Table("figure", *boards, "goal", title=scene.about)
    for key in SHOWN:
        cells = [_cell(part["figures"].get(key)) for part in boards.values()]
        if any(cells):
            goals = "; ".join(f"{goal.of} {goal.most:g}" for name, goal in scene.goals if name == key)
            table.add_row(key, *cells, goals)
    table.add_row("lost", *(f"{len(part['lost'])} of {part['flights']}" for part in boards.values()), "0")
    return table


def _cell(figure: dict[str, float] | None) -> str:
    return "" if figure is None else f"{figure['median']:g} / {figure['p90']:g} / {figure['worst']:g}"
