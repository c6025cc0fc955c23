"""The tables of docs/lab/genuine.md and genuine-triggers.md, of what `lab hil --results` flew.

The prose of both pages is written by hand; a table stands between `<!-- table NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from lab.campaign import Row
from lab.hil.flights import SIMULATED
from lab.hil.scenes import FIGURES, GOALS, HOLD, LINES, MEANS, by_line
from lab.hil.triggers import by_story, story_figures
from tools.markdown import table

OF: Final = {0.5: "median", 0.9: "p90", 1.0: "worst"}
SHOWN: Final[Mapping[str, str]] = {"told": "warned"}
"""Figures of the triggers whose names in the results the page does not use."""


def _scenes(rows: Mapping[str, Sequence[Row]]) -> Iterator[str]:
    """Genuine and simulated boards side by side, by each line; a figure that misses a goal is bold."""
    found = by_line(rows["hil scenes"])
    names = [f"{board if board == SIMULATED else 'genuine'} by {line}" for board, line in found]

    def cells(part: Row) -> Iterator[str]:
        yield str(part["flights"])
        for key in FIGURES:
            shown = " / ".join(f"{value:.2f}" for value in part.get(key, {}).values())
            mean = f", mean {part[f'{key}_mean']:.2f}" if key in MEANS and shown else ""
            yield f"**{shown}{mean}**" if key in part["missed"] and shown else shown + mean
        lost = str(part["flights"] - part["finished"])
        yield lost if lost == "0" else f"**{lost}**"

    figures = ("flights", *FIGURES.values(), "lost, or scene not flown")
    columns = [list(cells(part)) for part in found.values()]
    goals = [["10", *(_goal(key, line) for key in FIGURES), "0"] for line in LINES]
    head = ("median / p90 / worst", *names, *(f"goal by {line}" for line in LINES))
    yield from table(head, zip(figures, *columns, *goals, strict=True))


def _goal(key: str, line: str) -> str:
    if key in MEANS:
        return "mean {:g} to {:g}".format(*MEANS[key])
    share, most = (GOALS | {"hold_cm": HOLD[line]})[key]
    return f"{OF[share]} {most:g}"


def _triggers(rows: Mapping[str, Sequence[Row]]) -> Iterator[str]:
    """Every story: what the firmware held, over all flights."""
    yield from table(
        ("story", "figure", "least / median / most", "goal", "right"),
        (
            (name.replace("_", " "), SHOWN.get(figure, figure.replace("_", " ")), shown, goal, _right(found))
            for name, found in by_story(rows["hil triggers"])
            for figure, shown, goal in story_figures(name, found)
        ),
    )


def _right(found: Sequence[Row]) -> str:
    right = sum(not each["missed"] for each in found)
    return f"{right} of {len(found)}" if right == len(found) else f"**{right} of {len(found)}**"


TABLES: Final[Mapping[str, Callable[[Mapping[str, Sequence[Row]]], Iterator[str]]]] = {
    "scenes": _scenes,
    "triggers": _triggers,
}
