"""The tables of docs/lab/genuine.md and genuine-triggers.md, of what `lab hil --results` flew.

The prose of both pages is written by hand; a table stands between `<!-- table NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from lab.campaign import Row
from lab.hil.scenes import compared
from lab.hil.triggers import by_story, story_figures
from tools.markdown import table

SHOWN: Final[Mapping[str, str]] = {"told": "warned"}
"""Figures of the triggers whose names in the results the page does not use."""


def _scenes(rows: Mapping[str, Sequence[Row]]) -> Iterator[str]:
    """Genuine and simulated boards side by side, by each line; a figure that misses a goal is bold."""
    found = compared(rows["hil scenes"])
    columns = [name for name in found[0] if name not in ("figure", "missed", "holds")]
    yield from table(
        ("median / p90 / worst", *columns),
        [
            (row["figure"], *(f"**{row[name]}**" if name in row["missed"] else row[name] for name in columns))
            for row in found
        ],
    )


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
