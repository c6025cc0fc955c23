"""A trend in one line of text: as many bars as there is room."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

BARS: Final = "▁▂▃▄▅▆▇█"
"""From the least to the greatest."""


def sparkline(values: Iterable[float | None], width: int, *, least: float | None = None) -> str:
    """A bar for each value, the lowest for the least; where there are more than have room, the greatest of each group.

    Args:
        values: in order; None where there was none, which leaves a space.
        width: of the text.
        least: value of an empty bar; the least of the values by default.
    """
    shown = _grouped(list(values), width)
    known = [value for value in shown if value is not None]
    if not known:
        return ""
    low = min(known) if least is None else least
    span = max(known) - low
    return "".join(" " if value is None else _bar((value - low) / span if span > 0.0 else 0.0) for value in shown)


def _bar(share: float) -> str:
    return BARS[min(max(round(share * (len(BARS) - 1)), 0), len(BARS) - 1)]


def _grouped(values: Sequence[float | None], width: int) -> Sequence[float | None]:
    count = len(values)
    if count <= width:
        return values
    groups = (values[place * count // width : (place + 1) * count // width] for place in range(width))
    return [max((value for value in group if value is not None), default=None) for group in groups]
