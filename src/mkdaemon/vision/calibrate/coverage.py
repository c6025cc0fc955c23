"""Which views a calibration still lacks, in words a person with a board in hand can follow."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.calibrate.board import BoardPoints, board_normal

Array = npt.NDArray[np.float64]

CELLS = (4, 3)
"""Columns and rows the picture is divided into."""
POINTS_PER_CELL = 6
TILT_DEG = 18.0
NEAR_SHARE, FAR_SHARE = 0.6, 0.4
"""Width of the seen part of the board over the width of the picture: near from, far up to."""
MIN_VIEWS = 12
NOVEL_SHARE = 0.025
"""A view is new when its points moved by this share of the picture's width."""

_COLUMNS = ("left", "centre left", "centre right", "right")
_ROWS = ("top", "middle", "bottom")
_TILTS = {
    "left": "turn the board so that its left side comes towards the camera",
    "right": "turn the board so that its right side comes towards the camera",
    "top": "lean the board so that its top comes towards the camera",
    "bottom": "lean the board so that its bottom comes towards the camera",
}


class Coverage:
    """Collects views of one camera.

    Attributes:
        views: taken so far.
        levels: of each, black, middle and white of edges `(n, 3)`; see `tone.edge_levels`.

    Args:
        width: of the pictures [px].
        height: of the pictures [px].
    """

    def __init__(self, width: int, height: int) -> None:
        self.views: list[BoardPoints] = []
        self.levels: list[Array] = []
        self.size = (width, height)
        self._cells = np.zeros((CELLS[1], CELLS[0]), dtype=np.int64)
        self._tilts: set[str] = set()
        self._near = self._far = False

    def add(self, view: BoardPoints) -> None:
        """Count a view."""
        self.views.append(view)
        width, height = self.size
        columns = np.clip(view.image[:, 0] * CELLS[0] / width, 0, CELLS[0] - 1).astype(int)
        rows = np.clip(view.image[:, 1] * CELLS[1] / height, 0, CELLS[1] - 1).astype(int)
        np.add.at(self._cells, (rows, columns), 1)
        self._tilts |= self._tilt(view)
        share = float(np.ptp(view.image[:, 0])) / width
        self._near |= share >= NEAR_SHARE or float(np.ptp(view.image[:, 1])) / height >= NEAR_SHARE
        self._far |= share <= FAR_SHARE

    def is_novel(self, view: BoardPoints) -> bool:
        """Whether a view differs from all before by more than a shake of the hand."""
        limit = NOVEL_SHARE * self.size[0]
        for old in self.views:
            _, here, there = np.intersect1d(view.ids, old.ids, return_indices=True)
            if len(here) >= 4:
                moved = np.linalg.norm(view.image[here] - old.image[there], axis=1)
                if float(moved.mean()) < limit:
                    return False
        return True

    def missing(self) -> list[str]:
        """What to show next, most useful first; empty when the views will do."""
        wanted = []
        empty = np.argwhere(self._cells < POINTS_PER_CELL)
        middle = (np.array(self._cells.shape) - 1) / 2
        for row, column in sorted(empty.tolist(), key=lambda cell: -math.dist(cell, middle)):
            wanted.append(f"show the board in the {_ROWS[row]} {_COLUMNS[column]} of the picture")
        wanted += [words for side, words in _TILTS.items() if side not in self._tilts]
        if not self._near:
            wanted.append("come closer: let the board fill more than half of the picture")
        if not self._far:
            wanted.append("go back: let the board fill a third of the picture")
        if len(self.views) < MIN_VIEWS:
            wanted.append(f"{MIN_VIEWS - len(self.views)} more views from anywhere")
        return wanted

    def share(self) -> float:
        """How much of what is wanted has been seen, 0 to 1."""
        total = self._cells.size + len(_TILTS) + 2 + 1
        return 1.0 - len(self.missing()) / total

    def picture(self) -> list[str]:
        """What has been seen, as rows of letters: parts of the picture, tilts, distances."""
        line = "+" + "------+" * CELLS[0]
        rows = [line]
        for counts in self._cells:
            rows += ["|" + "".join("  ok  |" if count >= POINTS_PER_CELL else "      |" for count in counts), line]
        tilts = ", ".join(f"{side} {_word(side in self._tilts)}" for side in _TILTS)
        return [*rows, f"tilted: {tilts}", f"distance: near {_word(self._near)}, far {_word(self._far)}"]

    def _tilt(self, view: BoardPoints) -> set[str]:
        """Sides of the board that lean towards the camera, seen from the camera."""
        normal = board_normal(view, *self.size)
        if normal is None:
            return set()
        limit = math.sin(math.radians(TILT_DEG))
        sides = set()
        if normal[0] > limit:
            sides.add("left")  # facing right: its left side is nearer
        if normal[0] < -limit:
            sides.add("right")
        if normal[1] > limit:
            sides.add("top")
        if normal[1] < -limit:
            sides.add("bottom")
        return sides


def _word(is_seen: bool) -> str:
    return "ok" if is_seen else "MISSING"
