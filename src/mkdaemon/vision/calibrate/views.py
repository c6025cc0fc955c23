"""Collecting views of a board: from a folder, or live with guidance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError
from mkdaemon.files import save
from mkdaemon.vision.calibrate.board import BoardPoints, CalibrationBoard
from mkdaemon.vision.calibrate.coverage import Coverage
from mkdaemon.vision.calibrate.tone_curve import edge_levels
from mkdaemon.vision.camera.files import list_pictures
from mkdaemon.vision.camera.imagecodec import read_picture
from mkdaemon.vision.camera.shot import PictureError

Grey = npt.NDArray[np.uint8]

STILL_PX = 1.5
"""Mean motion of the board between two images up to which it counts as held still: blur stays below a pixel."""


@dataclass(frozen=True, slots=True)
class ViewReport:
    """What became of one image.

    Attributes:
        name: of the file, or the image's number.
        points: board points found; 0 when the board was not seen.
        taken: counted as a view.
        reason: why not, when not.
    """

    name: str
    points: int
    taken: bool
    reason: str = ""


def views_of_folder(folder: Path, board: CalibrationBoard) -> Iterator[tuple[ViewReport, Coverage]]:
    """Look for the board in every picture of a folder; the coverage grows from report to report.

    Raises:
        VisionError: no folder, no pictures, or pictures of different sizes.
    """
    coverage: Coverage | None = None
    size, first = (0, 0), ""
    for path in list_pictures(folder):
        try:
            pixels = read_picture(path)
        except PictureError as error:
            if coverage is not None:
                yield ViewReport(path.name, 0, False, str(error)), coverage
            continue
        height, width = pixels.shape
        if coverage is None:
            coverage, size, first = Coverage(width, height), (width, height), path.name
        if (width, height) != size:
            msg = f"{path.name} is {width}x{height}, {first} is {size[0]}x{size[1]}: calibrate one size at a time"
            raise VisionError(msg)
        view = board.find(pixels)
        if view is None:
            yield ViewReport(path.name, 0, False, "board not found"), coverage
        else:
            coverage.add(view)
            coverage.levels.append(edge_levels(pixels, *board.edges(view)))
            yield ViewReport(path.name, len(view.ids), True), coverage


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
        self._size = (0, 0)
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
        height, width = pixels.shape
        if self.coverage is None:
            self.coverage, self._size = Coverage(width, height), (width, height)
        if (width, height) != self._size:
            before_size = "x".join(map(str, self._size))
            msg = f"the camera changed from {before_size} to {width}x{height}: set its size and start again"
            raise VisionError(msg)
        view, before = self._board.find(pixels), self._last
        self._last = view
        if view is None:
            return ViewReport(name, 0, False, "no board in the picture")
        count = len(view.ids)
        if before is None or _motion(before, view) > STILL_PX:
            return ViewReport(name, count, False, "hold still")
        if not self.coverage.is_novel(view):
            return ViewReport(name, count, False, "move on")
        self.coverage.add(view)
        self.coverage.levels.append(edge_levels(pixels, *self._board.edges(view)))
        if self._keep is not None:
            _, picture = cv2.imencode(".png", pixels)
            save(self._keep / f"view{len(self.coverage.views):03d}.png", picture.tobytes(), overwrite=True)
        return ViewReport(name, count, True)


def _motion(before: BoardPoints, now: BoardPoints) -> float:
    """Mean distance the common points moved [px]; infinite without any."""
    _, here, there = np.intersect1d(now.ids, before.ids, return_indices=True)
    if not len(here):
        return float("inf")
    return float(np.linalg.norm(now.image[here] - before.image[there], axis=1).mean())
