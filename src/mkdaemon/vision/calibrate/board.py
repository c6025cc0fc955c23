"""Calibration boards: where their points are, and finding them in an image."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import ConfigError
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.tags.cellread import sample
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import TagMap, Target

CELLS_PER_SQUARE = 8
"""A square of our ChArUco boards is 8 cells: a 4x4 marker with its border is 6, one white cell on each side."""
MARKER_CELLS = 6
DICTIONARY = cv2.aruco.DICT_4X4_250
LEAST_SQUARES, MOST_MARKERS = 3, 250
"""Squares along a side at least, and markers the dictionary has."""
SQUARE_M = (0.002, 1.0)
"""Plausible sides of printed squares [m]."""
MIN_POINTS = 8
ALONG: Final = (0.35, 0.42, 0.5, 0.58, 0.65)
"""Where an edge is looked at, shares of its length: corners and markers are far."""
ASIDE: Final = 0.09
"""How far beside it black and white are read, share of its length; a marker begins at an eighth."""
LEAST_PX: Final = 3.0
"""The same at least: blur ends there [px]."""
CONTRAST: Final = 40.0
"""Between black and white at least [grey]."""
GREYS: Final = (4.0, 250.0)
"""Grey values that are neither crushed nor blown."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardPoints:
    """Points of a board seen in one image.

    Attributes:
        ids: `(n,)`.
        board: `(n, 3)` [m; board].
        image: `(n, 2)` [px, centres at integers].
        size: width and height of the image [px].
        levels: black, middle and white of straight edges `(m, 3)` [grey]; none of tags.
    """

    ids: npt.NDArray[np.int64]
    board: Array
    image: Array
    size: tuple[int, int]
    levels: Array = field(default_factory=lambda: np.empty((0, 3)))

    @property
    def normal(self) -> Array:
        """Direction the board faces `(3,)` [camera, RDF], by a guessed focal length of one picture width."""
        width, height = self.size
        guess = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], dtype=np.float64)
        _, rvec, tvec = cv2.solvePnP(self.board, self.image, guess, None, flags=cv2.SOLVEPNP_IPPE)
        normal = np.asarray(cv2.Rodrigues(rvec)[0], dtype=np.float64)[:, 2]
        return -normal if float(normal @ tvec.ravel()) > 0 else normal


@dataclass(frozen=True)
class CharucoBoard:
    """A chess board of `columns` by `rows` squares of a side [m], with a marker in each white one."""

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        markers = self.columns * self.rows // 2
        is_whole = min(self.columns, self.rows) >= LEAST_SQUARES and markers <= MOST_MARKERS
        if not (is_whole and SQUARE_M[0] <= self.square <= SQUARE_M[1]):
            msg = (
                f"board {self.columns}x{self.rows} of {self.square} m: give at least 3x3 squares, at most 500,"
                " of 0.002 to 1 m"
            )
            raise ConfigError(msg)

    @property
    def title(self) -> str:
        """For example `charuco 8x6, square 0.03 m`."""
        return f"charuco {self.columns}x{self.rows}, square {self.square:g} m"

    @cached_property
    def _detector(self) -> cv2.aruco.CharucoDetector:
        marker = self.square * MARKER_CELLS / CELLS_PER_SQUARE
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, marker, dictionary)
        return cv2.aruco.CharucoDetector(board)

    @cached_property
    def cells(self) -> Grey:
        """The board as cells `(8 * rows, 8 * columns)`, 0 black, 255 white."""
        size = (self.columns * CELLS_PER_SQUARE, self.rows * CELLS_PER_SQUARE)
        return np.asarray(self._detector.getBoard().generateImage(size, marginSize=0), dtype=np.uint8)

    def find(self, pixels: Grey) -> BoardPoints | None:
        """Inner chess corners next to decoded markers in `(h, w)` uint8, refined to their saddle points.

        The origin of the board is its top-left corner, y to the bottom, as OpenCV has it; None when too little is seen.
        """
        corners, ids, _, _ = self._detector.detectBoard(pixels)
        if ids is None or len(ids) < MIN_POINTS or self._detector.getBoard().checkCharucoCornersCollinear(ids):
            return None
        index = np.asarray(ids, dtype=np.int64).ravel()
        known = np.asarray(self._detector.getBoard().getChessboardCorners(), dtype=np.float64)
        image = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
        grid = np.full((self.rows - 1, self.columns - 1, 2), np.nan)
        grid.reshape(-1, 2)[index] = image
        return BoardPoints(index, known[index], image, (pixels.shape[1], pixels.shape[0]), edge_levels(pixels, grid))


class TagBoard:
    """A grid of tags, or any other flat target of the target map, as a calibration board."""

    def __init__(self, target: Target) -> None:
        if not target.is_planar:
            msg = f"target '{target.name}' is not flat: calibrate with a board"
            raise ConfigError(msg)
        self._target = target
        self._detector = Detector(TagMap((target,)).whitelist)
        self._place = {tag.code: (k, tag) for k, tag in enumerate(target.tags)}

    @property
    def title(self) -> str:
        """For example `target deck: 24 tags of 0.06 m`."""
        return f"target {self._target.name}: {len(self._target.tags)} tags of {self._target.tags[0].size:g} m"

    def find(self, pixels: Grey) -> BoardPoints | None:
        """Corners of all decoded tags in `(h, w)` uint8; None when too little is seen."""
        found = [(*self._place[one.code], one.corners) for one in self._detector.search_all(pixels)]
        if 4 * len(found) < MIN_POINTS:
            return None
        places, tags, corners = zip(*found, strict=True)
        ids = (4 * np.array(places)[:, None] + np.arange(4)).ravel()
        known = np.concatenate([tag.corners for tag in tags])
        return BoardPoints(ids, known, np.concatenate(corners), (pixels.shape[1], pixels.shape[0]))


CalibrationBoard = CharucoBoard | TagBoard
"""Something flat with known points."""


def edge_levels(pixels: Grey, corners: Array) -> Array:
    """Black, middle and white `(n, 3)` of the straight edges between neighbours of a grid of corners.

    Corners `(rows, columns, 2)` [px], which no tone curve moves, are not a number where they are not seen. Edges that
    are too short, too pale, crushed or blown are left out.
    """
    ways = (corners[:, :-1], corners[:, 1:]), (corners[:-1], corners[1:])
    edges = np.concatenate([np.concatenate(ends, axis=-1).reshape(-1, 4) for ends in ways])
    edges = edges[np.isfinite(edges).all(axis=1)]
    if not len(edges):
        return np.empty((0, 3))
    starts, ends = edges[:, :2], edges[:, 2:]
    along = ends - starts
    length = np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.column_stack([-along[:, 1], along[:, 0]]) * ASIDE
    places = starts[:, None, :] + np.array(ALONG)[None, :, None] * along[:, None, :]
    first, middle, second = (
        sample(pixels, (places + side * aside[:, None, :]).reshape(-1, 2)).reshape(len(places), -1).mean(axis=1)
        for side in (-1.0, 0.0, 1.0)
    )
    black, white = np.minimum(first, second), np.maximum(first, second)
    good = (length[:, 0] * ASIDE > LEAST_PX) & (white - black > CONTRAST) & (black > GREYS[0]) & (white < GREYS[1])
    levels: Array = np.column_stack([black, middle, white])[good]
    return levels
