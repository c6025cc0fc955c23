"""From decoded tags or a prediction to a measured pose of one target: which start, which fit, which candidate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.limits import APART2, HALF, LIMITS
from mkdaemon.vision.pose.ambiguity import mirror_odds
from mkdaemon.vision.pose.edgefind import HALF_WIDTH
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.gates import CellReader
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import Pose, apart, length2
from mkdaemon.vision.pose.prints import SQUARE
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.pose.unknowns import TargetLevel
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.tagmap import Tag, Target


def _shrink(part: Grey, scale: float) -> Grey:
    return np.asarray(cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)


ROOM, ROOM_PX = 0.2, 14.0
"""Room around a target in a window: share of its size, plus a margin [px]."""
GREY_EFFORT: Final = 4
"""Duration of a fit to grey values over one to edges: 4 to 20 ms, on VGA."""
PATCH_PX = 40
"""The image of a target is compared with the next one at about this size [px]."""


class TargetFitter:
    """Measures one target.

    Attributes:
        target: that is measured.
        projection: of the camera.
        edges: fits it to edges, and asks them.
        cells: reads them.
        bend_known: what is known about the bend of the print.
        effort: spent since it was set to zero, in fits to edges; one to grey values takes as long as `GREY_EFFORT`.
    """

    def __init__(self, target: Target, projection: Projection) -> None:
        self.target = target
        self.effort = 0
        self.projection = projection
        self.edges = EdgeFit(target, projection)
        self._photo = PhotoFit(target, projection)
        sheet = self._photo.prints.sheet
        self.bend_known = None if sheet is None else sheet.prior
        self.cells = CellReader(target, projection)
        self._outline = np.concatenate([tag.place(SQUARE * tag.paper / 2) for tag in target.tags])

    def cold(self, pixels: Grey, starts: Sequence[Pose]) -> list[Pose]:
        """Fit every pose that decoded tags allow, as `solve` finds them; rival poses stay in the list."""
        candidates = [self._photo.prints.gathered(pixels, start) for start in starts]
        # Losses compare only between fits of one kind.
        for photometric in (True, False) if any(self._wants_photometric(c) for c in candidates) else (False,):
            fitted = [self._fit(pixels, candidate, photometric=photometric) for candidate in candidates]
            good = [pose for pose in fitted if pose is not None]
            if good and (not photometric or len(good) == len(candidates)):
                return good if photometric else [self._photo.polish(pixels, pose) for pose in good]
        return candidates

    def refine(self, pixels: Grey, start: Pose, level: TargetLevel | None = None) -> Pose | None:
        """Improve a pose by the method its size, tilt and blur ask for, with a level its tilt held near it."""
        start = self._photo.prints.gathered(pixels, start)
        grey: Pose | None = None
        if self._wants_photometric(start) or self.is_small(start):
            grey = self._fit(pixels, start, photometric=True, level=level)
            if grey is not None and (self._has_small_cells(start) or self._holds(grey)):
                return grey
        edges = self._fit(pixels, start, photometric=False, level=level)
        if edges is None:
            return grey
        cell_px = self._photo.prints.cell_px(edges)
        is_melted, is_noisy = cell_px < edges.melted_px, edges.rms_px > LIMITS.edges.located_px
        # The dimmer corners of small white cells are clipped less than their middle, which moves edges differently.
        is_flooded = edges.blown > HALF and cell_px < LIMITS.cells.small_px
        if grey is None and (is_melted or is_noisy or is_flooded):
            # Edges that melted lie; others have found the place, from which a few steps are left.
            blur_px = (edges.blur_px or 0.0) / HALF_WIDTH
            grey = self._fit(pixels, start if is_melted else edges, photometric=True, level=level, blur_px=blur_px)
            if grey is not None and self._holds(grey):
                return grey
        if grey is None or not is_melted or (not is_noisy and not self._photo.resembles(grey)):
            # Nothing else is known, or something lies over the print.
            return edges
        # A streak that is not the same all over the print, or a fit that has not got there: neither is sure.
        distance2 = length2(apart(edges, grey), edges.covariance + grey.covariance)
        return replace(edges, covariance=distance2 * edges.covariance) if distance2 > APART2 else edges

    def _holds(self, grey: Pose) -> bool:
        """Whether a fit to grey values is the whole truth of an image."""
        return self._photo.explains(grey) and grey.unexplained_px <= LIMITS.certainty.blind_rms_px

    def is_small(self, pose: Pose) -> bool:
        """Whether cells are so small that grey values measure the target, alone or after edges."""
        return self._photo.prints.cell_px(pose) < LIMITS.cells.mixed_px

    def _has_small_cells(self, start: Pose) -> bool:
        return self._photo.prints.cell_px(start) < LIMITS.cells.photometric_px

    def _wants_photometric(self, start: Pose) -> bool:
        is_steep = self._photo.prints.looked_at(start)[2] > LIMITS.cells.edges_up_to
        return is_steep or self._has_small_cells(start)

    def _fit(
        self,
        pixels: Grey,
        start: Pose,
        *,
        photometric: bool,
        level: TargetLevel | None = None,
        blur_px: float | None = None,
        rival: Pose | None = None,
    ) -> Pose | None:
        """Fit by one method; see `EdgeFit.fit` and `PhotoFit.fit`."""
        if not photometric:
            self.effort += 1
            return self.edges.fit(pixels, start, level=level)
        fitted = self._photo.fit(pixels, start, level=level, blur_px=blur_px, rival=rival)
        self.effort += 1 if fitted is None else GREY_EFFORT
        return fitted if fitted is not None and np.isfinite(fitted.rms_px) else None

    def fit_mirrored(self, pixels: Grey, pose: Pose) -> Pose | None:
        """Fit the rival of a pose, its normal mirrored about the line of sight: `pose` again, perhaps, or none."""
        origin, toward, tilt = self._photo.prints.looked_at(pose)
        axis = np.cross(pose.rotation[:, 2], toward)
        turned = np.asarray(cv2.Rodrigues(axis / max(float(np.linalg.norm(axis)), 1e-9) * 2 * tilt)[0]) @ pose.rotation
        start = replace(pose, rotation=turned, position=pose.rotation @ origin + pose.position - turned @ origin)
        start = self._photo.prints.gathered(pixels, start)
        return self._fit(pixels, start, photometric=pose.source == "photometric", rival=pose)

    def mirror_odds(self, pixels: Grey, pose: Pose) -> float:
        """Log odds against the rival of a pose before it is fitted; see `ambiguity.mirror_odds`.

        A target that is out of view in part shows too little of its perspective: zero.
        """
        seen, visible = self.projection.project(self._outline @ pose.rotation.T + pose.position)
        is_in_view = visible.all() and (seen >= 0).all() and (seen < pixels.shape[::-1]).all()
        return mirror_odds(pose, self.target.tags[0].size, float(self.projection.focal[0])) if is_in_view else 0.0

    def fit_grey_values(self, pixels: Grey, rivals: Sequence[Pose]) -> list[Pose]:
        """Fit rivals of a small tag once more on all its pixels; empty when one of them cannot be."""
        fitted = [self._fit(pixels, rival, photometric=True) for rival in rivals]
        return [pose for pose in fitted if pose is not None] if all(fitted) else []

    def window(self, pose: Pose, shape: tuple[int, ...]) -> tuple[int, int, int, int] | None:
        """Part of the image `(x0, y0, x1, y1)` [px] that holds the target with room to spare."""
        seen, visible = self.projection.project(self._outline @ pose.rotation.T + pose.position)
        if not bool(visible.any()):
            return None
        low, high = seen[visible].min(axis=0), seen[visible].max(axis=0)
        room = ROOM * float((high - low).max()) + ROOM_PX
        x0, y0 = np.maximum(low - room, 0).astype(int)
        x1, y1 = np.minimum(high + room + 1, [shape[1], shape[0]]).astype(int)
        if not bool(visible.all()):
            return 0, 0, shape[1], shape[0]
        return (int(x0), int(y0), int(x1), int(y1)) if min(x1 - x0, y1 - y0) >= LIMITS.search.min_window_px else None

    def carried(self, before: Grey, now: Grey, last: Pose) -> Pose | None:
        """Predict the pose by matching the target's image, assuming pure rotation; None without a match.

        `last` is its pose in the image `before` `(h, w)`.
        """
        outline = np.concatenate([tag.outline for tag in self.target.tags])
        reach = int(LIMITS.search.shake * float(self.projection.focal[0]))
        height, width = now.shape
        seen, visible = self.projection.project(outline @ last.rotation.T + last.position)
        centre, ahead = self.projection.project(last.position[None, :])
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
        # The turn takes the ray to the target's old place to its new one: rotation vector old x new, for a small angle.
        rays = self.projection.undistort(np.vstack([centre, centre + np.array(place) / coarse - reach]))
        old, new = (np.append(ray, 1.0) / np.hypot(1.0, np.linalg.norm(ray)) for ray in rays)
        turned = np.asarray(cv2.Rodrigues(np.cross(old, new))[0], dtype=np.float64)
        return replace(last, rotation=turned @ last.rotation, position=turned @ last.position)

    def side_px(self, pose: Pose) -> float:
        """Side of the largest tag in the image [px]."""
        return float(self.projection.focal[0]) * self.target.tags[0].size / max(float(pose.position[2]), NEAR_M)

    def disagreement(self, pose: Pose, tags: Sequence[tuple[Tag, Detection]]) -> float:
        """Largest mean corner distance between decoded tags and where the pose puts them [cells of the tag]."""
        worst = 0.0
        for tag, found in tags:
            corners = tag.corners @ pose.rotation.T + pose.position
            seen, visible = self.projection.project(corners, pose.motion)
            if not bool(visible.all()):
                return float("inf")
            distance = float(np.linalg.norm(seen - found.corners, axis=1).mean())
            worst = max(worst, distance / max(found.side_px / tag.family.size_cells, 1.0))
        return worst
