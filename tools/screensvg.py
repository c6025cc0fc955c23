"""A screen of letters as SVG, and what other pictures of the documentation are drawn with."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Final
from xml.sax.saxutils import escape

from rich.text import Text

_CHAR, _LINE, _MARGIN = 8.4, 18, 14
"""Width of a letter, height of a line, and border [px]."""
_COLOURS: Final = {
    "": "#d0d0d0",
    "dim": "#8a8a8a",
    "bold": "#ffffff",
    "green": "#7fd77f",
    "bold red": "#ff7070",
    "bold yellow": "#e8c35a",
    "reverse": "#1c1c1c",
}


def screen_svg(lines: Sequence[Text], columns: int) -> str:
    """Draw a screen.

    Args:
        lines: its rows; each part in one style.
        columns: its width.
    """
    width, height = 2 * _MARGIN + columns * _CHAR, 2 * _MARGIN + len(lines) * _LINE
    rows = [_row(line, _MARGIN + (number + 0.75) * _LINE) for number, line in enumerate(lines)]
    return svg_of(width, height, [f'<rect width="{width:g}" height="{height:g}" rx="6" fill="#1c1c1c"/>', *rows])


def _row(line: Text, y: float) -> str:
    """One line of the screen; every piece of one style is placed by its column."""
    styles = [""] * len(line.plain)
    for span in line.spans:
        styles[span.start : span.end] = [str(span.style)] * (span.end - span.start)
    pieces, start = [], 0
    for style, group in groupby(styles):
        words = line.plain[start : start + len(list(group))]
        if words.strip():
            left = start + len(words) - len(words.lstrip(" "))
            if style == "reverse":
                place = f'x="{_MARGIN + start * _CHAR:.1f}" y="{y - 0.75 * _LINE:.1f}" width="{len(words) * _CHAR:.1f}"'
                pieces.append(f'<rect {place} height="{_LINE}" fill="#d0d0d0"/>\n')
            pieces.append(svg_text(_MARGIN + left * _CHAR, y, words.strip(" "), _COLOURS[style], bold="bold" in style))
        start += len(words)
    return "".join(pieces)


def svg_text(x: float, y: float, words: str, colour: str, *, bold: bool = False, anchor: str = "start") -> str:
    """Words at a place, in letters of one width where they begin there."""
    weight = ' font-weight="bold"' if bold else ""
    length = f' textLength="{len(words) * _CHAR:.1f}"' if anchor == "start" else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}"{weight}{length} text-anchor="{anchor}" '
        f'xml:space="preserve">{escape(words)}</text>\n'
    )


def svg_of(width: float, height: float, parts: Sequence[str]) -> str:
    """A picture of these parts."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        f'height="{height:g}" font-family="monospace" font-size="14">\n'
    )
    return head + "\n".join(part.rstrip("\n") for part in parts) + "\n</svg>\n"
