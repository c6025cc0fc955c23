"""A start for a fit of several prints: a pose that one of them gave puts the others beside their place.

A tag of 27 px knows its tilt to a degree or two; at the next tag, two metres away, these are more pixels than a cell
has, and no fit would get there. Each print is therefore looked for around where the start puts it, as a whole.
Source: normalised cross-correlation; J. P. Lewis, "Fast normalized cross-correlation", 1995.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import Limits
from mkdaemon.vision.pose.pose import Pose, correlation
from mkdaemon.vision.pose.printmodel import SQUARE, PrintModel
from mkdaemon.vision.pose.prints import Prints
from mkdaemon.vision.pose.projection import NEAR_M, Projection

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

SPREAD: Final = np.eye(2)
"""Of the point spread with which prints are looked for [px^2]: a little wide, so that a start need not be exact."""
REACH: Final = 0.6
"""How far from its place a print is looked for, of its size in the image."""


class PrintGatherer:
    """Finds the prints of one target around a start.

    Args:
        prints: of the target.
        projection: of the lens.
        limits: all thresholds.
    """

    def __init__(self, prints: Prints, projection: Projection, limits: Limits) -> None:
        self._prints, self._projection, self._limits = prints, projection, limits.photo

    def gathered(self, pixels: Grey, start: Pose) -> Pose:
        """The start, moved to where the prints are found; as it is where all are in their place, or one is found alone.

        Args:
            pixels: `(h, w)` uint8.
            start: from one print or from the images before.
        """
        seen = self._prints.seen(start.rotation, start.position, pixels.shape)
        if len(seen) < 2:
            return start
        looked = [(model, self._shift(pixels, model, start)) for model in seen]
        found = [(model, shift) for model, shift in looked if shift is not None]
        if len(found) < 2 or not any(shift.any() for _, shift in found):
            return start
        places = [SQUARE * model.half @ model.axes[:, :2].T + model.origin for model, _ in found]
        points = np.concatenate(places)
        pixels_of = self._projection.project(points @ start.rotation.T + start.position)[0]
        rays = self._projection.undistort(pixels_of + np.repeat([shift for _, shift in found], len(SQUARE), axis=0))
        turned, place = np.asarray(cv2.Rodrigues(start.rotation)[0], np.float64), start.position.reshape(3, 1).copy()
        found_one, vector, moved = cv2.solvePnP(points, rays, np.eye(3), None, turned, place, useExtrinsicGuess=True)
        position = np.asarray(moved, np.float64).ravel()
        if not found_one or not np.isfinite(position).all() or position[2] < NEAR_M:
            return start
        return replace(start, rotation=np.asarray(cv2.Rodrigues(vector)[0], np.float64), position=position)

    def _shift(self, pixels: Grey, model: PrintModel, start: Pose) -> Array | None:
        """How far a print is beside its place `(2,)` [px]; zero where it is near, none where it is not found."""
        rendered = model.render(pixels.shape, start.rotation, start.position, SPREAD)
        if rendered is None:
            return None
        template, mask, left, top = rendered.template()
        height, width = template.shape
        here = pixels[top : top + height, left : left + width].astype(np.float32)
        if int(mask.sum()) < self._limits.min_window_px**2:
            return None
        if correlation(here[mask].astype(np.float64), template[mask].astype(np.float64)) >= self._limits.found_match:
            return np.zeros(2)
        reach = int(np.ceil(REACH * max(width, height)))
        x0, y0 = max(left - reach, 0), max(top - reach, 0)
        x1, y1 = min(left + width + reach, pixels.shape[1]), min(top + height + reach, pixels.shape[0])
        around = pixels[y0:y1, x0:x1].astype(np.float32)
        score = cv2.matchTemplate(around, template, cv2.TM_CCOEFF_NORMED, mask=mask.astype(np.float32))
        score = np.where(np.isfinite(score), score, -1.0)
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[row, column] < self._limits.found_match:
            return None
        return np.array([float(column + x0 - left), float(row + y0 - top)])
