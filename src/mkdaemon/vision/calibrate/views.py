"""Collecting views of a board, from a folder or live, and which are still missing, in words a person can follow."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.calibrate.board import BoardPoints, CalibrationBoard
from mkdaemon.vision.camera.image import PictureError
from mkdaemon.vision.camera.imagecodec import read_picture, write_picture
from mkdaemon.vision.camera.sources import list_pictures

POINTS_PER_PART = 6
"""From which a part of the picture is seen."""
TILT_DEG = 18.0
NEAR_SHARE, FAR_SHARE = 0.6, 0.4
"""Width of the seen part of the board over the width of the picture: near from, far up to."""
MIN_VIEWS = 12
NOVEL_SHARE = 0.025
"""A view is new when its points moved by this share of the picture's width."""

_COLUMNS = ("left", "centre left", "centre right", "right")
_ROWS = ("top", "middle", "bottom")
_SIZE = (len(_COLUMNS), len(_ROWS))
_PARTS = sorted(np.ndindex(_SIZE[::-1]), key=lambda part: -math.dist(part, (1.0, 1.5)))
_WANTED = {
    **{
        f"{_ROWS[row]} {_COLUMNS[column]}": f"show the board in the {_ROWS[row]} {_COLUMNS[column]} of the picture"
        for row, column in _PARTS
    },
    "left": "turn the board so that its left side comes towards the camera",
    "right": "turn the board so that its right side comes towards the camera",
    "top": "lean the board so that its top comes towards the camera",
    "bottom": "lean the board so that its bottom comes towards the camera",
    "near": "come closer: let the board fill more than half of the picture",
    "far": "go back: let the board fill a third of the picture",
}
"""Parts of the picture, sides that lean towards the camera, and distances, most useful first, with how to show each."""

LEAST_COMMON = 4
"""Points of two views that tell how far the board moved."""
STILL_PX = 1.5
"""Mean motion of the board between two images up to which it counts as held still: blur stays below a pixel."""


@dataclass(frozen=True, slots=True)
class ViewReport:
    """Result of one image: its name, whether it counts as a view, its coverage, or the reason against it."""

    name: str
    is_taken: bool
    words: str


class Views:
    """Takes views of a board from pictures of one size, and knows which are missing.

    Args:
        keep: folder for the pictures taken, which replace those of an earlier run; None keeps none.
    """

    def __init__(self, board: CalibrationBoard, keep: Path | None = None) -> None:
        self._board, self._keep = board, keep
        self.taken: list[BoardPoints] = []
        self._points: Counter[str] = Counter()
        self._first: tuple[str, tuple[int, ...]] | None = None
        self._last: BoardPoints | None = None
        if keep is not None:
            keep.mkdir(parents=True, exist_ok=True)

    def take(self, name: str, pixels: Grey, *, is_live: bool = False) -> ViewReport:
        """Look at one image `(h, w)` uint8; from a running camera only still and new ones are views.

        Raises:
            VisionError: it has another size than those before.
        """
        self._first = self._first or (name, pixels.shape)
        first, shape = self._first
        if pixels.shape != shape:
            now, before = (f"{width}x{height}" for height, width in (pixels.shape, shape))
            msg = f"{name} is {now}, {first} is {before}: calibrate one fixed size at a time"
            raise VisionError(msg)
        view, last = self._board.find(pixels), self._last
        self._last = view
        if view is None:
            return ViewReport(name, is_taken=False, words="board not found")
        if is_live and (last is None or not _is_near(last, view, STILL_PX)):
            return ViewReport(name, is_taken=False, words="hold still")
        if is_live and not self.is_novel(view):
            return ViewReport(name, is_taken=False, words="move on")
        self.add(view)
        if self._keep is not None:
            write_picture(self._keep / f"view{len(self.taken):03d}.png", pixels, overwrite=True)
        return ViewReport(name, is_taken=True, words=f"{len(view.ids)} points")

    def take_folder(self, folder: Path) -> Iterator[ViewReport]:
        """Look for the board in every picture of a folder.

        Raises:
            VisionError: no folder, no pictures, or pictures of different sizes.
        """
        for path in list_pictures(folder):
            try:
                yield self.take(path.name, read_picture(path))
            except PictureError as error:
                yield ViewReport(path.name, is_taken=False, words=str(error))

    def add(self, view: BoardPoints) -> None:
        """Count a view."""
        self.taken.append(view)
        places = np.clip(view.image / view.size * _SIZE, 0, np.subtract(_SIZE, 1)).astype(int)
        self._points.update(f"{_ROWS[row]} {_COLUMNS[column]}" for column, row in places.tolist())
        wide, high = np.ptp(view.image, axis=0) / view.size
        # A board that faces right has its left side nearer.
        x, y, _ = view.normal / math.sin(math.radians(TILT_DEG))
        shown = {
            "near": max(wide, high) >= NEAR_SHARE,
            "far": wide <= FAR_SHARE,
            "left": x > 1.0,
            "right": x < -1.0,
            "top": y > 1.0,
            "bottom": y < -1.0,
        }
        self._points.update(dict.fromkeys((name for name, is_shown in shown.items() if is_shown), POINTS_PER_PART))

    def is_novel(self, view: BoardPoints) -> bool:
        """Whether a view differs from all before by more than a shake of the hand."""
        return not any(_is_near(old, view, NOVEL_SHARE * view.size[0]) for old in self.taken)

    def missing(self) -> list[str]:
        """Views still needed, most useful first; empty if the views suffice."""
        more = MIN_VIEWS - len(self.taken)
        wanted = [words for name, words in _WANTED.items() if self._points[name] < POINTS_PER_PART]
        return wanted + ([f"{more} more views from anywhere"] if more > 0 else [])

    def share(self) -> float:
        """Share of the needed views, 0 to 1."""
        return 1.0 - len(self.missing()) / (len(_WANTED) + 1)


def _is_near(before: BoardPoints, now: BoardPoints, limit: float) -> bool:
    """Whether the points that both views have moved by less than this in the mean [px]."""
    _, here, there = np.intersect1d(now.ids, before.ids, return_indices=True)
    moves = np.linalg.norm(now.image[here] - before.image[there], axis=1)
    return len(moves) >= LEAST_COMMON and float(moves.mean()) < limit
