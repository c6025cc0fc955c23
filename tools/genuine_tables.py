"""The tables of docs/lab/genuine.md and genuine-triggers.md, of what `lab hil --results` flew.

The prose of both pages is written by hand; a table stands between `<!-- table NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from lab.campaign import Row
from lab.hil.flights import SIMULATED
from lab.hil.scenes import FIGURES, LINES, Figure, summary
from lab.hil.triggers import by_story, story_figures
from tools.markdown import table

SHOWN: Final[Mapping[str, str]] = {"told": "warned"}
"""Figures of the triggers whose names in the results the page does not use."""


def _scenes(rows: Mapping[str, Sequence[Row]]) -> Iterator[str]:
    """Genuine and simulated boards side by side, by each line; a figure that misses a goal is bold."""
    flown = rows["hil scenes"]
    boards = sorted({row["board"] for row in flown}, key=lambda board: board == SIMULATED)
    columns = [
        (board, line, summary(line, [row for row in flown if (row["board"], row["line"]) == (board, line)]))
        for line in LINES
        for board in boards
    ]
    columns = [column for column in columns if column[2]["flights"]]
    head = [f"{_board(board)} by {line}" for board, line, _ in columns]
    yield from table(
        ("median / p90 / worst", *head, *(f"goal by {line}" for line in LINES)),
        [
            ("flights", *(str(part["flights"]) for _, _, part in columns), "10", "10"),
            *(
                (
                    figure.about,
                    *(_cell(figure, part) for _, _, part in columns),
                    *(figure.goal_words(line) for line in LINES),
                )
                for figure in FIGURES
            ),
            ("lost, or scene not flown", *(_lost(part) for _, _, part in columns), "0", "0"),
        ],
    )


def _board(board: str) -> str:
    return SIMULATED if board == SIMULATED else "genuine"


def _cell(figure: Figure, part: Mapping[str, Any]) -> str:
    found = part["figures"].get(figure.key)
    if found is None:
        return ""
    shown = figure.shown(found)
    return f"**{shown}**" if any(words.startswith(f"{figure.key}:") for words in part["missed"]) else shown


def _lost(part: Mapping[str, Any]) -> str:
    return f"**{len(part['lost'])}**" if part["lost"] else "0"


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


def _right(found: Sequence[Mapping[str, Any]]) -> str:
    right = sum(not each["missed"] for each in found)
    return f"{right} of {len(found)}" if right == len(found) else f"**{right} of {len(found)}**"


TABLES: Final[Mapping[str, Callable[[Mapping[str, Sequence[Row]]], Iterator[str]]]] = {
    "scenes": _scenes,
    "triggers": _triggers,
}
