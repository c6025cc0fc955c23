"""A picture in letters: two pixels a letter in grey, or one of ten letters where a terminal has no colours. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from rich.color import Color
from rich.style import Style
from rich.text import Text

Grey = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

RAMP: Final = " .:-=+*#%@"
"""Letters from dark to light."""
OUTLINE: Final = (60, 220, 80)
"""Colour of tags."""


def picture_rows(pixels: Grey, outlines: Sequence[Array], columns: int, rows: int, *, has_colours: bool) -> list[Text]:
    """Draw a picture.

    Args:
        pixels: `(h, w)` uint8.
        outlines: corners of tags `(4, 2)` [px].
        columns: at most.
        rows: at most.
        has_colours: two pixels a letter, in grey, tags green; else letters, tags `o`.

    Returns:
        Rows of letters.
    """
    height, width = pixels.shape
    factor = min(columns / width, 2 * rows / height)
    across, down = max(int(width * factor), 1), max(2 * (int(height * factor) // 2), 2)
    small = _shrunk(pixels, across, down)
    marked = _marked(outlines, across / width, down / height, small.shape)
    return [_row(small[row : row + 2], marked[row : row + 2], has_colours=has_colours) for row in range(0, down, 2)]


def _shrunk(pixels: Grey, across: int, down: int) -> Grey:
    """Means of equal parts `(down, across)`; a picture that is smaller is repeated."""
    height, width = pixels.shape
    rows = np.minimum(np.arange(down + 1) * height // down, height - 1)[:-1]
    columns = np.minimum(np.arange(across + 1) * width // across, width - 1)[:-1]
    sums = np.add.reduceat(np.add.reduceat(pixels.astype(np.int64), rows, axis=0), columns, axis=1)
    sizes = np.outer(np.diff(np.append(rows, height)), np.diff(np.append(columns, width)))
    if (np.diff(rows) == 0).any() or (np.diff(columns) == 0).any():
        return np.asarray(pixels[rows][:, columns], np.uint8)
    return np.asarray(sums // sizes, np.uint8)


def _marked(outlines: Sequence[Array], across: float, down: float, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    """Which pixels of the small picture an outline passes."""
    marked = np.zeros(shape, bool)
    for corners in outlines:
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            steps = np.linspace(0.0, 1.0, 2 * max(shape))[:, None]
            places = ((start + steps * (end - start) + 0.5) * (across, down)).astype(int)
            inside = (places >= 0).all(axis=1) & (places[:, 0] < shape[1]) & (places[:, 1] < shape[0])
            marked[places[inside, 1], places[inside, 0]] = True
    return marked


def _row(grey: Grey, marked: npt.NDArray[np.bool_], *, has_colours: bool) -> Text:
    if not has_colours:
        means = (grey.mean(axis=0) / 256 * len(RAMP)).astype(int)
        return Text("".join("o" if marked[:, place].any() else RAMP[mean] for place, mean in enumerate(means)))
    row = Text()
    for column in range(grey.shape[1]):
        upper, lower = (OUTLINE if marked[half, column] else (int(grey[half, column]),) * 3 for half in (0, 1))
        row.append("\u2580", Style(color=Color.from_rgb(*upper), bgcolor=Color.from_rgb(*lower)))
    return row
