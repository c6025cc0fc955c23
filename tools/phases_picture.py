"""The picture of docs/modes.md: the phases of authority and what leads from one to another, from their table."""

from __future__ import annotations

import math
from itertools import chain
from pathlib import Path
from textwrap import wrap
from typing import Final

from mkdaemon.control.modes import IN_FLIGHT, ROWS, Row, Trigger
from mkdaemon.telemetry.control import Phase
from tools.screensvg import svg_of, svg_text

Point = tuple[float, float]
_INK, _LINE, _PALE, _GROUND = "#222222", "#555555", "#f2f2f2", "#ffffff"
_HEAD: Final = (
    '<defs><marker id="tip" markerWidth="10" markerHeight="8" refX="9" refY="4" orient="auto-start-reverse">'
    f'<path d="M 0 0 L 10 4 L 0 8 z" fill="{_LINE}"/></marker></defs>'
)
_WIDE, _HIGH, _APART = 140, 44, 26
"""Size of a box, and distance between the two arrows of a pair [px]."""
_WIDTH, _HEIGHT = 1480, 720
_FEW: Final = 3
"""How many events an arrow names; the table has more."""
_PLACES: Final[dict[Phase, Point]] = {
    Phase.FREE: (170, 60),
    Phase.LEASED: (480, 60),
    Phase.RELEASING: (170, 560),
    Phase.FLYING: (960, 110),
    Phase.STALE: (960, 430),
    Phase.UNANSWERED: (1370, 110),
    Phase.ABORTED: (1370, 430),
    Phase.LANDING: (1170, 620),
}
"""Middle of each box [px]."""
_FLIGHT: Final = (800, 15, 660, 665)
"""The frame of the phases in flight: left, top, width, height [px]."""
_LEAVING: Final[dict[Phase, tuple[Point, Point]]] = {
    Phase.RELEASING: ((800, 560), (244, 560)),
    Phase.LEASED: ((800, 470), (488, 86)),
}
"""Where the arrow of all phases in flight begins and ends, by its target [px]."""


def phases_picture(_root: Path) -> str:
    """Return the phases with their transitions, as SVG; guards of events other than a tick are in the table only."""
    pairs: dict[tuple[Phase, Phase], list[str]] = {}
    for row in ROWS:
        for source in row.sources:
            if source is not row.target:
                pairs.setdefault((source, row.target), []).append(_words(row))
    shared = {target: [words for way in IN_FLIGHT for words in pairs.pop((way, target))] for target in _LEAVING}
    left, top, width, height = _FLIGHT
    frame = f'x="{left}" y="{top}" width="{width}" height="{height}"'
    parts = [
        _HEAD,
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="{_GROUND}"/>',
        f'<rect {frame} rx="10" fill="none" stroke="{_LINE}" stroke-dasharray="6 4"/>',
        svg_text(left + 12, top + height - 14, "in flight: stick frames are sent", _INK, bold=True),
    ]
    lines = [
        (_sides(_PLACES[source], _PLACES[target], is_pair=(target, source) in pairs), labels)
        for (source, target), labels in pairs.items()
    ]
    lines += [((*_LEAVING[target], (0.0, 0.0)), labels) for target, labels in shared.items()]
    arrows, words = zip(*(_join(line, labels) for line, labels in lines), strict=True)
    parts += arrows
    for phase, (x, y) in _PLACES.items():
        place = f'x="{x - _WIDE // 2}" y="{y - _HIGH // 2}" width="{_WIDE}" height="{_HIGH}"'
        parts.append(f'<rect {place} rx="6" fill="{_PALE}" stroke="{_LINE}"/>')
        parts.append(svg_text(x, y + 5, phase.value, _INK, bold=True, anchor="middle"))
    return svg_of(_WIDTH, _HEIGHT, [*parts, *chain.from_iterable(words)])


def _words(row: Row) -> str:
    return row.guard.meaning if row.event is Trigger.TICK else row.event.value


def _sides(start: Point, end: Point, *, is_pair: bool) -> tuple[Point, Point, Point]:
    """Where a line between two boxes meets their rims, and the way from it to its words.

    The two lines of a pair run beside each other, with their words outside.
    """
    far = math.dist(start, end)
    ahead = ((end[0] - start[0]) / far, (end[1] - start[1]) / far)
    beside = (-ahead[1], ahead[0]) if is_pair else (0.0, 0.0)
    to_side = _WIDE / 2 / abs(ahead[0]) if ahead[0] else math.inf
    to_top = _HIGH / 2 / abs(ahead[1]) if ahead[1] else math.inf
    out = min(to_side, to_top) + 2
    x, y = beside[0] * _APART / 2, beside[1] * _APART / 2
    return (
        (start[0] + ahead[0] * out + x, start[1] + ahead[1] * out + y),
        (end[0] - ahead[0] * out + x, end[1] - ahead[1] * out + y),
        beside,
    )


def _join(line: tuple[Point, Point, Point], labels: list[str]) -> tuple[str, list[str]]:
    """An arrow, and what leads along it: in its middle, or beside it where it is one of a pair."""
    (x, y), (to_x, to_y), beside = line
    path = f"M {x:.1f} {y:.1f} L {to_x:.1f} {to_y:.1f}"
    arrow = f'<path d="{path}" stroke="{_LINE}" stroke-width="2" marker-end="url(#tip)"/>'
    several = dict.fromkeys(labels)
    rows = [f"any of {len(several)} events"] if len(several) > _FEW else [w for one in several for w in wrap(one, 18)]
    above, half = 8.5 * len(rows), 4.2 * max(map(len, rows)) + 3
    away = abs(beside[0]) * half + abs(beside[1]) * above + 2
    share = 0.5 if any(beside) else 0.4 if x <= _FLIGHT[0] else 0.75
    middle = (x + (to_x - x) * share + beside[0] * away, y + (to_y - y) * share + beside[1] * away)
    ground = f'x="{middle[0] - half:.1f}" y="{middle[1] - above:.1f}" width="{2 * half:.1f}" height="{2 * above:.1f}"'
    words = [f'<rect {ground} fill="{_GROUND}" fill-opacity="0.9"/>']
    for number, row in enumerate(rows):
        words.append(svg_text(middle[0], middle[1] - above + 13 + 17 * number, row, _INK, anchor="middle"))
    return arrow, words
