"""`python -m lab hil --case scenes`: every scene of the table, and the goal of every figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from lab import tables
from lab.campaign import Ending, Row, carried_out, summed_up
from lab.hil.flights import PAD_STARTS, SIMULATED, STEP, Leg, SceneFlight, Setting, aircraft_of, config_of
from mkdaemon.virtualtime import run_virtually
from mksim.config import WindClass
from mksim.programs.rehearsal import land, over_pad, take_off

LINES: Final = ("cable", "radio")
"""How the boards are reached."""
DEGRADED: Final = ": degraded: "
"""In a warning about the line: attitudes that a radio's burst of lost frames has eaten are overdue indeed."""
HOLD_ENDS: Final = 34.0
"""Then light wind begins [s]; step and moderate wind are flown by copies."""
LIGHT_FORKS: Final = 45.0
"""A copy lands then [s]."""
LEGS: Final = (
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


FIGURES: Final = {
    "hold_cm": "hold, indoor air [cm]",
    "light_cm": "hold, light wind [cm]",
    "moderate_cm": "hold, moderate wind [cm]",
    "step_t90": "step of 1 m, nine tenths after [s]",
    "step_over_percent": "its overshoot [%]",
    "touch_cm": "landing in light wind, from the middle [cm]",
    "moving_touch_cm": "landing on a pad that moves at 0.5 m/s, from its middle [cm]",
    "nees_level": "NEES of the place",
    "nees_height": "NEES of the height",
    "false_warnings": "false warnings",
}
"""Figures of a flight, in the order of the table."""
MEANS: Final = {"nees_level": (0.7, 1.5), "nees_height": (0.7, 1.5)}
"""Least and most of the mean of these."""
GOALS: Final = {
    "light_cm": (0.5, 8.0),
    "moderate_cm": (0.5, 14.0),
    "step_t90": (0.5, 1.7),
    "step_over_percent": (0.9, 10.0),
    "touch_cm": (0.9, 6.0),
    "moving_touch_cm": (0.9, 9.0),
    "false_warnings": (1.0, 0.0),
}
"""Which share of the flights does not exceed what."""
HOLD: Final = {"cable": (0.5, 3.2), "radio": (0.5, 4.5)}
"""The same of the hold in indoor air, by line."""


def fly(setting: Setting) -> Row:
    """Fly every scene once in virtual time; see `lab.hil.flights.figures`."""

    async def found() -> Row:
        config = config_of(setting)
        flight = SceneFlight(config, aircraft_of(setting, config), LEGS)
        await flight.fly()
        return flight.found

    return run_virtually(found())


def summary(line: str, flights: Sequence[Row]) -> Row:
    """What flights by one line say together; see `lab.campaign.summed_up`.

    Returns:
        How they ended and their figures; the means of `MEANS`; which figures `missed` a goal; `holds`: none, and all
        finished. All warnings are false, for nothing is wrong, but those of a radio that loses frames.
    """
    flown = []
    for row in flights:
        false = sum(line != "radio" or DEGRADED not in text for text in row["warnings"])
        end = {"ending": Ending.LOST if row["lost"] else Ending.FINISHED, "why": "; ".join(row["lost"])}
        flown.append(row | end | {"false_warnings": false})
    found, goals = summed_up(flown, *FIGURES), GOALS | {"hold_cm": HOLD[line]}
    means = {key: float(np.mean([row.get(key, math.nan) for row in flown])) for key in MEANS}
    missed = [key for key, (share, most) in goals.items() if not found.get(key, {}).get(str(share), math.inf) <= most]
    missed += [key for key, (least, most) in MEANS.items() if not least <= means[key] <= most]
    figures = {f"{key}_mean": value for key, value in means.items()}
    return found | figures | {"missed": missed, "holds": found["holds"] and not missed}


def by_line(rows: Sequence[Row]) -> dict[tuple[str, str], Row]:
    """The summary of every board, genuine ones first, by each line."""
    parts: dict[tuple[str, str], list[Row]] = {}
    for row in sorted(carried_out(rows), key=lambda row: (LINES.index(row["line"]), row["board"] == SIMULATED)):
        parts.setdefault((row["board"], row["line"]), []).append(row)
    return {(board, line): summary(line, part) for (board, line), part in parts.items()}


def show(rows: Sequence[Row], *, as_json: bool) -> int:
    """Print the figures of every board and line; exit code 1 where a goal is missed, or a flight not flown."""
    shown: list[Row] = [{"board": board, "line": line} | found for (board, line), found in by_line(rows).items()]
    unflown = [f"{row['board']} {row['seed']}: {row['why']}" for row in rows if row.get("ending") == Ending.FAILED]
    shown.append({"board": "not flown", "line": "", "unfinished": unflown, "holds": not unflown})
    return tables.show(shown, ("board", "line"), as_json=as_json)
