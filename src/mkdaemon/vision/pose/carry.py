"""Carrying the pose of one image over to the next by what moved in the image, where a prediction does not reach."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.tags.cover import covered
from mkdaemon.vision.tags.tagmap import Target

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

FLOW_POINTS = 60
"""Corners that are followed; more cost time."""
PATCH_PX = 40
"""The image of a target is compared at about this size [px]."""
BORDER = 3
"""White cells around a corner of three; of one, all others are black."""


class Carrier:
    """Finds a target again that was seen a moment ago."""

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        self._readable_px = LIMITS.cells.readable_px
        self._smallest_px = LIMITS.search.min_window_px
        self._corners, self._cells = _cell_corners(target)

    def starts(self, before: Grey, now: Grey, last: Pose, predicted: Pose) -> Iterator[Pose]:
        """Poses to start a fit from, the more precise way first.

        Args:
            before: image of the last pose `(h, w)` uint8.
            now: image to look in.
            last: pose in `before`.
            predicted: expected in `now`.
        """
        flown = self.flow(before, now, last, predicted)
        if flown is not None:
            yield flown
        shifted = self.shift(before, now, last)
        if shifted is not None:
            yield shifted

    def flow(self, before: Grey, now: Grey, last: Pose, predicted: Pose) -> Pose | None:
        """Carry the last pose over by the optical flow of the corners of its cells; none when too few are found."""
        seen, visible = self._projection.project(self._corners @ last.rotation.T + last.position)
        height, width = now.shape
        edge = LIMITS.track.edge_px
        visible &= (seen > edge).all(axis=1) & (seen < (width - 1 - edge, height - 1 - edge)).all(axis=1)
        # Corners of smaller cells have nothing for optical flow to hold on to.
        visible &= self._cells * float(self._projection.focal[0]) > self._readable_px * float(last.position[2])
        index = np.flatnonzero(visible)
        if len(index) < LIMITS.track.flow_min_points:
            return None
        if len(index) > FLOW_POINTS:
            index = index[np.linspace(0, len(index) - 1, FLOW_POINTS).astype(np.intp)]
        points = self._corners[index]
        guess, _ = self._projection.project(points @ predicted.rotation.T + predicted.position)
        window = (21, 21)
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            before,
            now,
            seen[index].astype(np.float32).reshape(-1, 1, 2),
            guess.astype(np.float32).reshape(-1, 1, 2),
            winSize=window,
            maxLevel=3,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 12, 0.03),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=LIMITS.track.flow_contrast,
        )
        good = np.asarray(status).ravel() > 0
        if int(good.sum()) < LIMITS.track.flow_min_points:
            return None
        rays = self._projection.undistort(np.asarray(moved, dtype=np.float64).reshape(-1, 2)[good])
        start_r = cv2.Rodrigues(predicted.rotation)[0]
        found, rvec, tvec, inliers = cv2.solvePnPRansac(
            points[good],
            rays,
            np.eye(3),
            np.zeros(0),
            rvec=start_r.copy(),
            tvec=predicted.position.reshape(3, 1).copy(),
            useExtrinsicGuess=True,
            iterationsCount=40,
            reprojectionError=3.0 / float(self._projection.focal[0]),
            flags=cv2.SOLVEPNP_ITERATIVE,
        )
        if not found or inliers is None or len(inliers) < LIMITS.track.flow_min_points:
            return None
        rotation = np.asarray(cv2.Rodrigues(rvec)[0], dtype=np.float64)
        position = np.asarray(tvec, dtype=np.float64).ravel()
        if not np.isfinite(position).all() or position[2] < NEAR_M:
            return None
        return replace(predicted, rotation=rotation, position=position)

    def shift(self, before: Grey, now: Grey, last: Pose) -> Pose | None:
        """Carry the last pose over by where its image is found again as a whole: through blur, glare and noise.

        The camera is taken to have turned; none when the image is not found.
        """
        reach = int(LIMITS.track.shake * float(self._projection.focal[0]))
        height, width = now.shape
        seen, visible = self._projection.project(self._corners @ last.rotation.T + last.position)
        centre, ahead = self._projection.project(last.position[None, :])
        if not bool(visible.all() and ahead.all()):
            return None
        x0, y0 = np.maximum(seen.min(axis=0) - 2, reach).astype(int)
        x1, y1 = np.minimum(seen.max(axis=0) + 3, [width - reach, height - reach]).astype(int)
        if min(x1 - x0, y1 - y0) < self._smallest_px:
            return None
        coarse = 1.0 / max(min(x1 - x0, y1 - y0) // PATCH_PX, 1)
        patch = _shrink(before[y0:y1, x0:x1], coarse)
        area = _shrink(now[y0 - reach : y1 + reach, x0 - reach : x1 + reach], coarse)
        _, likeness, _, place = cv2.minMaxLoc(cv2.matchTemplate(area, patch, cv2.TM_CCOEFF_NORMED))
        if likeness < LIMITS.track.alike:
            return None
        rays = self._projection.undistort(np.vstack([centre, centre + np.array(place) / coarse - reach]))
        old, new = (np.append(ray, 1.0) / np.hypot(1.0, np.linalg.norm(ray)) for ray in rays)
        turned = np.asarray(cv2.Rodrigues(np.cross(old, new))[0], dtype=np.float64)
        return replace(last, rotation=turned @ last.rotation, position=turned @ last.position)


def _shrink(part: Grey, scale: float) -> Grey:
    if scale == 1.0:
        return part
    return np.asarray(cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _cell_corners(target: Target) -> tuple[Array, Array]:
    """Corners of the printed cells, where a small window shows motion both ways.

    Returns:
        Points `(n, 3)` [m; target] and the side of their cells `(n,)` [m].
    """
    points: list[Array] = []
    cells: list[Array] = []
    for k, tag in enumerate(target.tags):
        n = len(tag.bitmap)
        white = np.pad(tag.bitmap > 0, 1, constant_values=True).astype(int)
        around = white[:-1, :-1] + white[:-1, 1:] + white[1:, :-1] + white[1:, 1:]
        crossed = (around == 2) & (white[:-1, :-1] == white[1:, 1:])
        row, column = np.nonzero((around == 1) | (around == BORDER) | crossed)
        placed = tag.place(np.column_stack([column - n / 2, n / 2 - row]) * tag.module)
        keep = np.ones(len(placed), dtype=bool)
        for later in target.tags[k + 1 :]:
            keep &= ~covered(placed, later)
        points.append(placed[keep])
        cells.append(np.full(int(keep.sum()), tag.module))
    return np.concatenate(points), np.concatenate(cells)
