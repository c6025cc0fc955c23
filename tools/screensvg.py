"""A screen of letters as SVG."""

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
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        f'height="{height:g}" font-family="monospace" font-size="14">\n'
    )
    ground = f'<rect width="{width:g}" height="{height:g}" rx="6" fill="#1c1c1c"/>'
    return head + "\n".join(part.rstrip("\n") for part in (ground, *rows)) + "\n</svg>\n"


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
            weight = ' font-weight="bold"' if "bold" in style else ""
            text = words.strip(" ")
            pieces.append(
                f'<text x="{_MARGIN + left * _CHAR:.1f}" y="{y:.1f}" fill="{_COLOURS[style]}"{weight} '
                f'textLength="{len(text) * _CHAR:.1f}" text-anchor="start" xml:space="preserve">{escape(text)}</text>\n'
            )
        start += len(words)
    return "".join(pieces)
