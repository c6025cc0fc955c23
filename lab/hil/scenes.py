"""`python -m lab hil --case scenes`: every scene of the table, the goal of every figure, boards side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from lab import tables
from lab.campaign import Row, carried_out
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


class Goal(NamedTuple):
    """What a figure has to reach.

    Attributes:
        most: largest value that holds [unit of the figure].
        of: which of the flights' values is judged: `median`, `p90` or `worst`, or the `mean`.
        line: by which line it is asked for; both if empty.
        least: smallest value that holds.
    """

    most: float
    of: str = "median"
    line: str = ""
    least: float = -math.inf

    def words(self, line: str) -> str:
        """The goal by a line, as a table shows it; empty where it is not asked for."""
        if self.line not in ("", line):
            return ""
        least = "" if math.isinf(self.least) else f"{self.least:g} to "
        return f"{self.of} {least}{self.most:g}"


@dataclass(frozen=True, slots=True)
class Figure:
    """One row of the table.

    Attributes:
        key: of the figure in a flight.
        about: in words, with its unit.
        goals: of it.
        digits: behind the point.
    """

    key: str
    about: str
    goals: tuple[Goal, ...]
    digits: int = 1

    def goal_words(self, line: str) -> str:
        """Its goals by a line."""
        return "; ".join(words for goal in self.goals if (words := goal.words(line)))

    def shown(self, found: Mapping[str, float]) -> str:
        """Median / 90th percentile / worst of all flights, and their mean where that is judged."""
        words = " / ".join(f"{found[of]:.{self.digits}f}" for of in ("median", "p90", "worst"))
        has_mean = any(goal.of == "mean" for goal in self.goals)
        return f"{words}, mean {found['mean']:.{self.digits}f}" if has_mean else words


FIGURES: Final = (
    Figure(
        "hold_cm",
        "hold, indoor air [cm]",
        (Goal(3.2, line="cable"), Goal(4.5, "worst", "cable"), Goal(4.5, line="radio")),
    ),
    Figure("light_cm", "hold, light wind [cm]", (Goal(8.0),)),
    Figure("moderate_cm", "hold, moderate wind [cm]", (Goal(14.0),)),
    Figure("step_t90", "step of 1 m, nine tenths after [s]", (Goal(1.7),), 2),
    Figure("step_over_percent", "its overshoot [%]", (Goal(10.0, "p90"),)),
    Figure("touch_cm", "landing in light wind, from the middle [cm]", (Goal(6.0, "p90"),)),
    Figure("moving_touch_cm", "landing on a pad that moves at 0.5 m/s, from its middle [cm]", (Goal(9.0, "p90"),)),
    Figure("nees_level", "NEES of the place", (Goal(1.5, "mean", least=0.7),), 2),
    Figure("nees_height", "NEES of the height", (Goal(1.5, "mean", least=0.7),), 2),
    Figure("filter_off_ms", "stick filter, off by [ms]", (Goal(10.0, "worst"),), 0),
    Figure("false_warnings", "false warnings", (Goal(0.0, "worst"),), 0),
    Figure("unanswered_nat", "evidence of no answer to the sticks, of 4 [nat]", (Goal(2.0, "worst"),), 2),
)
"""In the order of the table."""


def fly(setting: Setting) -> Row:
    """Fly every scene once in virtual time; see `lab.hil.flights.figures`."""

    async def found() -> Row:
        config = config_of(setting)
        flight = SceneFlight(config, aircraft_of(setting, config), LEGS)
        await flight.fly()
        return flight.found

    return run_virtually(found())


def summary(line: str, flights: Sequence[Row]) -> dict[str, Any]:
    """Median, 90th percentile, worst and mean of every figure, what was lost, and which goals are missed.

    Args:
        line: by which they were flown.
        flights: rows of the results; see `lab.hil.flights.figures`. All warnings are false, for nothing is wrong, but
            those of a radio that loses frames.
    """
    found, missed = dict[str, dict[str, float]](), list[str]()
    for figure in FIGURES:
        values = [_value(figure.key, line, flight) for flight in flights]
        measured = [value for value in values if value is not None]
        without = sum(value is None and not one["lost"] for value, one in zip(values, flights, strict=True))
        if without:
            missed.append(f"{figure.key}: not measured in {without} of {len(flights)} flights")
        if measured:
            median, p90, worst = (float(one) for one in np.percentile(measured, (50, 90, 100)))
            part = {"median": median, "p90": p90, "worst": worst, "mean": float(np.mean(measured))}
            found[figure.key] = part
            goals = [goal for goal in figure.goals if not goal.least <= part[goal.of] <= goal.most]
            missed += [f"{figure.key}: {words}" for goal in goals if (words := goal.words(line))]
    lost = [f"{flight['seed']}: {why}" for flight in flights for why in flight["lost"]]
    return {"flights": len(flights), "lost": lost, "figures": found, "missed": missed}


def _value(key: str, line: str, flight: Row) -> float | None:
    if key != "false_warnings":
        return flight.get(key)
    return sum(line != "radio" or DEGRADED not in text for text in flight["warnings"])


def compared(rows: Sequence[Row]) -> list[Row]:
    """Every figure of genuine and simulated boards by each line, side by side.

    Returns:
        Of each figure a row: the boards' columns, the goals by each line, which columns `missed` one, and `holds`.
    """
    found = carried_out(rows)
    boards = sorted({row["board"] for row in found}, key=lambda board: board == SIMULATED)
    columns = {
        f"{board if board == SIMULATED else 'genuine'} by {line}": (line, summary(line, part))
        for line in LINES
        for board in boards
        if (part := [row for row in found if (row["board"], row["line"]) == (board, line)])
    }
    shown: list[Row] = [{"figure": "flights"} | {name: str(part["flights"]) for name, (_, part) in columns.items()}]
    shown[0] |= {f"goal by {line}": "10" for line in LINES} | {"missed": []}
    for figure in FIGURES:
        goals = {f"goal by {line}": figure.goal_words(line) for line in LINES}
        parts = {name: part["figures"].get(figure.key) for name, (_, part) in columns.items()}
        cells = {name: figure.shown(part) if part else "" for name, part in parts.items()}
        missed = [
            name
            for name, (_, part) in columns.items()
            if any(one.startswith(f"{figure.key}:") for one in part["missed"])
        ]
        shown.append({"figure": figure.about} | cells | goals | {"missed": missed})
    lost = {name: part["lost"] for name, (_, part) in columns.items()}
    shown.append({"figure": "lost, or scene not flown"} | {name: str(len(why)) for name, why in lost.items()})
    shown[-1] |= {f"goal by {line}": "0" for line in LINES} | {"missed": [name for name in lost if lost[name]]}
    return [row | {"holds": not row["missed"]} for row in shown]


def show(rows: Sequence[Row], *, as_json: bool) -> int:
    """Print every figure of the boards side by side; exit code 1 where a goal is missed, or a flight not flown."""
    shown = compared(rows)
    lost = [f"{row['board']} {row['seed']}: {'; '.join(row.get('lost', [row.get('why')]))}" for row in rows]
    unflown = len(rows) - len(carried_out(rows))
    shown.append({"figure": "not flown", "flights": unflown, "holds": not unflown})
    return tables.show(shown, ("figure",), as_json=as_json, lost=[why for why in lost if not why.endswith(": ")])
