"""Carrying the pose of one image over to the next by where its image is found again, where a prediction is lost."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import Target

PATCH_PX = 40
"""The image of a target is compared at about this size [px]."""


class Carrier:
    """Finds a target again that was seen a moment ago, as a whole: through blur, glare and noise.

    Args:
        target: that was seen.
        projection: of the lens.
    """

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        self._outline = np.concatenate([tag.outline for tag in target.tags])

    def shift(self, before: Grey, now: Grey, last: Pose) -> Pose | None:
        """Where a camera that only turned sees the target now; none when its image is not found.

        Args:
            before: image of the last pose `(h, w)` uint8.
            now: image to look in.
            last: pose in `before`.
        """
        reach = int(LIMITS.search.shake * float(self._projection.focal[0]))
        height, width = now.shape
        seen, visible = self._projection.project(self._outline @ last.rotation.T + last.position)
        centre, ahead = self._projection.project(last.position[None, :])
        if not bool(visible.all() and ahead.all()):
            return None
        # Of a target that leaves the image the part is asked that is still in it after a shake.
        x0, y0 = np.maximum(seen.min(axis=0) - 2, reach).astype(int)
        x1, y1 = np.minimum(seen.max(axis=0) + 3, [width - reach, height - reach]).astype(int)
        if min(x1 - x0, y1 - y0) < LIMITS.search.min_window_px:
            return None
        coarse = 1.0 / max(min(x1 - x0, y1 - y0) // PATCH_PX, 1)
        patch = _shrink(before[y0:y1, x0:x1], coarse)
        area = _shrink(now[y0 - reach : y1 + reach, x0 - reach : x1 + reach], coarse)
        _, likeness, _, place = cv2.minMaxLoc(cv2.matchTemplate(area, patch, cv2.TM_CCOEFF_NORMED))
        if likeness < LIMITS.likeness.alike:
            return None
        rays = self._projection.undistort(np.vstack([centre, centre + np.array(place) / coarse - reach]))
        old, new = (np.append(ray, 1.0) / np.hypot(1.0, np.linalg.norm(ray)) for ray in rays)
        turned = np.asarray(cv2.Rodrigues(np.cross(old, new))[0], dtype=np.float64)
        return replace(last, rotation=turned @ last.rotation, position=turned @ last.position)


def _shrink(part: Grey, scale: float) -> Grey:
    return np.asarray(cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
