"""Collecting views of a board, from a folder or live, and which are still missing, in words a person can follow."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.files import save
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.calibrate.board import BoardPoints, CalibrationBoard, board_normal
from mkdaemon.vision.camera.image import PictureError
from mkdaemon.vision.camera.imagecodec import encode_png, read_picture
from mkdaemon.vision.camera.sources import list_pictures

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

STILL_PX = 1.5
"""Mean motion of the board between two images up to which it counts as held still: blur stays below a pixel."""


class Coverage:
    """Collects views of one camera, whose pictures are `width` x `height` [px], the first one of them by its name.

    Attributes:
        views: taken so far.
    """

    def __init__(self, width: int, height: int, first: str = "") -> None:
        self.views: list[BoardPoints] = []
        self.size, self.first = (width, height), first
        self._cells = np.zeros((CELLS[1], CELLS[0]), dtype=np.int64)
        self._tilts: set[str] = set()
        self._near = self._far = False

    def add(self, view: BoardPoints) -> None:
        """Count a view."""
        self.views.append(view)
        places = np.clip(view.image / self.size * CELLS, 0, np.subtract(CELLS, 1)).astype(int)
        np.add.at(self._cells, (places[:, 1], places[:, 0]), 1)
        self._tilts |= self._tilt(view)
        shares = np.ptp(view.image, axis=0) / self.size
        self._near |= bool(shares.max() >= NEAR_SHARE)
        self._far |= bool(shares[0] <= FAR_SHARE)

    def is_novel(self, view: BoardPoints) -> bool:
        """Whether a view differs from all before by more than a shake of the hand."""
        limit = NOVEL_SHARE * self.size[0]
        return not any(len(moves) >= 4 and moves.mean() < limit for moves in (_moves(old, view) for old in self.views))

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
        tilts, near, far = (
            ", ".join(f"{name} {'ok' if is_seen else 'MISSING'}" for name, is_seen in seen.items())
            for seen in ({side: side in self._tilts for side in _TILTS}, {"near": self._near}, {"far": self._far})
        )
        return [*rows, f"tilted: {tilts}", f"distance: {near}, {far}"]

    def _tilt(self, view: BoardPoints) -> set[str]:
        """Sides of the board that lean towards the camera, seen from the camera."""
        normal = board_normal(view, *self.size)
        if normal is None:
            return set()
        limit = math.sin(math.radians(TILT_DEG))
        leans = {"left": normal[0], "right": -normal[0], "top": normal[1], "bottom": -normal[1]}
        return {side for side, lean in leans.items() if lean > limit}  # facing right: its left side is nearer


@dataclass(frozen=True, slots=True)
class ViewReport:
    """What became of one image.

    Attributes:
        name: of the file, or the image's number.
        points: board points found; 0 when the board was not seen.
        reason: why it is no view; empty when it counts as one.
    """

    name: str
    points: int
    reason: str = ""

    @property
    def taken(self) -> bool:
        """Whether it counts as a view."""
        return not self.reason


def views_of_folder(folder: Path, board: CalibrationBoard) -> Iterator[tuple[ViewReport, Coverage]]:
    """Look for the board in every picture of a folder; the coverage grows from report to report.

    Raises:
        VisionError: no folder, no pictures, or pictures of different sizes.
    """
    coverage: Coverage | None = None
    for path in list_pictures(folder):
        try:
            pixels = read_picture(path)
        except PictureError as error:
            if coverage is not None:
                yield ViewReport(path.name, 0, str(error)), coverage
            continue
        coverage = _sized(coverage, path.name, pixels)
        view = board.find(pixels)
        if view is None:
            yield ViewReport(path.name, 0, "board not found"), coverage
        else:
            coverage.add(view)
            yield ViewReport(path.name, len(view.ids)), coverage


class LiveViews:
    """Takes views from a running camera: only sharp, still and new ones.

    Args:
        board: what is shown.
        keep: folder for the pictures taken, which replace those of an earlier run; None keeps none.
    """

    def __init__(self, board: CalibrationBoard, keep: Path | None = None) -> None:
        self._board = board
        self._keep = keep
        self._last: BoardPoints | None = None
        self._seen = 0
        self.coverage: Coverage | None = None
        if keep is not None:
            keep.mkdir(parents=True, exist_ok=True)

    def offer(self, pixels: Grey) -> ViewReport:
        """Look at one image `(h, w)` uint8.

        Raises:
            VisionError: the camera changed its size.
        """
        self._seen += 1
        name = f"image {self._seen}"
        self.coverage = _sized(self.coverage, name, pixels)
        view, before = self._board.find(pixels), self._last
        self._last = view
        if view is None:
            return ViewReport(name, 0, "no board in the picture")
        count = len(view.ids)
        if before is None or not len(moves := _moves(before, view)) or moves.mean() > STILL_PX:
            return ViewReport(name, count, "hold still")
        if not self.coverage.is_novel(view):
            return ViewReport(name, count, "move on")
        self.coverage.add(view)
        if self._keep is not None:
            save(self._keep / f"view{len(self.coverage.views):03d}.png", encode_png(pixels), overwrite=True)
        return ViewReport(name, count)


def _sized(coverage: Coverage | None, name: str, pixels: Grey) -> Coverage:
    """The coverage an image counts in; a VisionError where it has another size than those before."""
    height, width = pixels.shape
    coverage = coverage or Coverage(width, height, name)
    if (width, height) != coverage.size:
        before = "x".join(map(str, coverage.size))
        msg = f"{name} is {width}x{height}, {coverage.first} is {before}: calibrate one fixed size at a time"
        raise VisionError(msg)
    return coverage


def _moves(before: BoardPoints, now: BoardPoints) -> Array:
    """How far the common points moved `(n,)` [px]."""
    _, here, there = np.intersect1d(now.ids, before.ids, return_indices=True)
    return np.asarray(np.linalg.norm(now.image[here] - before.image[there], axis=1), dtype=np.float64)
