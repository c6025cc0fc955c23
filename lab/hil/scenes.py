"""What the table of the proving ground asks: boards, lines, what varies with the seed, and the goal of every figure."""

from __future__ import annotations

import math
import random
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lab.hil.flights import Setting

FIRST_SEED: Final = 81_000_000
"""Of reported figures; what is tuned uses seeds below 10000."""
SIMULATED: Final = "simulated"
"""The simulator's boards, in a table."""
LINES: Final = ("cable", "radio")
"""How the boards are reached."""
DEGRADED: Final = ": degraded: "
"""In a warning about the line: attitudes that a radio's burst of lost frames has eaten are overdue indeed."""
VOLTAGES: Final = (13.4, 13.6, 14.8, 15.6, 16.4, 16.8)
"""Of the battery, one for each seed [V]; with less the low battery ends every flight."""


@dataclass(frozen=True, slots=True)
class Goal:
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
    goals: tuple[Goal, ...] = ()
    digits: int = 1

    def goal_words(self, line: str) -> str:
        """Its goals by a line."""
        return "; ".join(words for goal in self.goals if (words := goal.words(line)))

    def shown(self, found: Mapping[str, float], *, mean: bool = True) -> str:
        """Median / 90th percentile / worst of all flights, and their mean."""
        words = " / ".join(f"{found[of]:.{self.digits}f}" for of in ("median", "p90", "worst"))
        return f"{words}, mean {found['mean']:.{self.digits}f}" if mean else words


FIGURES: Final = (
    Figure("take_off_far_cm", "take-off, farthest from the middle [cm]", digits=0),
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
    Figure("sink", "its sink at the touch [m/s]", digits=2),
    Figure("follow_cm", "over a pad that starts to move, 0.5 m/s [cm]"),
    Figure("moving_touch_cm", "landing on it, from its middle [cm]", (Goal(9.0, "p90"),)),
    Figure("nees_level", "NEES of the place", (Goal(1.5, "mean", least=0.7),), 2),
    Figure("nees_height", "NEES of the height", (Goal(1.5, "mean", least=0.7),), 2),
    Figure("filter_off_ms", "stick filter, off by [ms]", (Goal(10.0, "worst"),), 0),
    Figure("false_warnings", "false warnings", (Goal(0.0, "worst"),), 0),
    Figure("unanswered_nat", "evidence of no answer to the sticks, of 4 [nat]", (Goal(2.0, "worst"),), 2),
)
"""In the order of the table."""


def setting_of(board: str, line: str, seed: int) -> Setting:
    """The setting of a seed: every flight another battery, another heading, with a compass or without."""
    rng = random.Random(f"{seed} setting")
    return Setting(
        None if board == SIMULATED else board,
        seed,
        is_radio=line == "radio",
        voltage=rng.choice(VOLTAGES),
        yaw=rng.uniform(-math.pi, math.pi),
        has_compass=rng.random() < 0.7,
    )


def _false(line: str, warnings: Sequence[str]) -> int:
    """How many warnings of a flight in which nothing is wrong are false: all but those of a radio that loses frames."""
    return sum(line != "radio" or DEGRADED not in text for text in warnings)


def summary(line: str, flights: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Median, 90th percentile, worst and mean of every figure, what was lost, and which goals are missed.

    Args:
        line: by which they were flown.
        flights: rows of the results; see `lab.hil.flights.figures`.
    """
    figures, missed = {}, []
    flights = [flight | {"false_warnings": _false(line, flight["warnings"])} for flight in flights]
    for figure in FIGURES:
        values = [float(flight[figure.key]) for flight in flights if flight.get(figure.key) is not None]
        without = sum(flight.get(figure.key) is None and not flight["lost"] for flight in flights)
        if figure.goals and without:
            missed.append(f"{figure.key}: not measured in {without} of {len(flights)} flights")
        if not values:
            continue
        found = {
            "median": statistics.median(values),
            "p90": float(np.percentile(values, 90)),
            "worst": max(values),
            "mean": statistics.fmean(values),
        }
        figures[figure.key] = {name: round(value, 3) for name, value in found.items()} | {"flights": len(values)}
        missed += [
            f"{figure.key}: {words}"
            for goal in figure.goals
            if (words := goal.words(line)) and not goal.least <= found[goal.of] <= goal.most
        ]
    lost = [{"seed": flight["seed"], "why": why} for flight in flights for why in flight["lost"]]
    return {"flights": len(flights), "lost": lost, "figures": figures, "missed": missed}
