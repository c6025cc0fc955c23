"""From decoded tags or a prediction to a measured pose of one target: which fit, which candidate, which gate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS, Limits
from mkdaemon.vision.pose.bend import Bend
from mkdaemon.vision.pose.edgefind import HALF_WIDTH
from mkdaemon.vision.pose.edgefit import EdgeFit, Level
from mkdaemon.vision.pose.evidence import EdgeEvidence
from mkdaemon.vision.pose.gates import BitModel, CellEvidence
from mkdaemon.vision.pose.gather import PrintGatherer
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.pose.pose import Pose, solve
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.pose.rolling import KnownMotion
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.tagmap import Tag, Target

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

ROOM, ROOM_PX = 0.2, 14.0
"""Room around a target in a window: share of its size, and so much more [px]."""
WHOLE_ROOM_PX = 6.0
"""Room around a tag that is wholly in the image [px]: a search wants its quiet zone."""
MIXED_STEPS = 10
"""Of the fit to grey values after one to edges, as the width of the edges gives it a start: a streak of 30 px takes six
to grow (351 development images with motion blur; eight explained 5 images less)."""
CONFIRMED_BY = 3
"""Prints that fix a plane."""
DECODED_CELL_PX = 3
"""Cells from this size on are decoded in most images [px]."""


class TargetFitter:
    """Measures one target."""

    def __init__(self, target: Target, projection: Projection, limits: Limits = LIMITS) -> None:
        self.target = target
        self.rolls = projection.intrinsics.line_time > 0.0
        self._projection = projection
        self._limits = limits
        self._edges = EdgeFit(target, projection, limits=limits)
        self._photo = PhotoFit(target, projection, limits)
        sheet = self._photo.prints.sheet
        self.bend_known = None if sheet is None else sheet.prior
        self._gatherer = PrintGatherer(self._photo.prints, projection, limits)
        self._bits = BitModel(target, projection, limits)
        self._evidence = EdgeEvidence(target, projection, limits)
        papers = [tag.paper / 2 for tag in target.tags]
        square = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
        self._outline = np.concatenate(
            [tag.place(square * half) for tag, half in zip(target.tags, papers, strict=True)]
        )

    def cold(
        self,
        pixels: Grey,
        tags: Sequence[tuple[Tag, Detection]],
        motion_at: Callable[[Array], KnownMotion] | None = None,
        bend: Bend | None = None,
    ) -> list[Pose]:
        """Fit every candidate that decoded tags allow; rival poses stay in the list.

        Args:
            pixels: `(h, w)` uint8.
            tags: decoded, with their places in the target.
            motion_at: what is known about the motion of a target at a place `(3,)` [m; RDF] under a rolling shutter.
            bend: what is known about that of the print.
        """
        candidates = solve(tags, self._projection)
        if len(tags) > 1 and (not candidates or candidates[0].rms_px > self._limits.health.agreement_px):
            # A border faked by something lying over the tag: let every tag speak for itself.
            candidates = [pose for pair in tags for pose in solve([pair], self._projection)]
        candidates = [replace(pose, known_bend=bend) for pose in candidates]
        if motion_at is not None:
            candidates = [replace(pose, known_motion=motion_at(pose.position)) for pose in candidates]
        candidates = [self._gatherer.gathered(pixels, candidate) for candidate in candidates]
        # Losses compare only between fits of one kind, so all candidates get the one the first of them asks for.
        for photometric in (True, False) if any(self._wants_photometric(c) for c in candidates) else (False,):
            fitted = [self._fit(pixels, candidate, photometric=photometric) for candidate in candidates]
            good = [pose for pose in fitted if pose is not None]
            if good and (not photometric or len(good) == len(candidates) or self._are_confirmed(pixels, good)):
                return good if photometric else [self._photo.polish(pixels, pose) for pose in good]
        return candidates

    def _are_confirmed(self, pixels: Grey, fitted: Sequence[Pose]) -> bool:
        """Whether prints that fix a plane speak for each candidate, so that one that could not be fitted is none.

        About the line of two prints, or of a row of them, a pose may be turned like that of a single one.
        """
        for pose in fitted:
            places = np.array([model.origin for model in self._photo.shows(pixels, pose)])
            if len(places) < CONFIRMED_BY:
                return False
            if np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[1] < self.target.tags[0].size:
                return False
        return True

    def refine(self, pixels: Grey, start: Pose, level: Level | None = None) -> Pose | None:
        """Improve a pose by the method its size, tilt and blur ask for, with a level its tilt held near it."""
        start = self._gatherer.gathered(pixels, start)
        most = self._limits.certainty.blind_grey_rms_px
        if self._wants_photometric(start):
            grey = self._fit(pixels, start, photometric=True, level=level)
            if grey is not None and (grey.unexplained_px <= most or self._has_small_cells(start)):
                return grey
            # Large cells in a steep view, of a print cut by the border: grey values may stay on the way, with a streak.
            edges = self._fit(pixels, start, photometric=False, level=level)
            is_better = grey is None or (edges is not None and edges.rms_px < grey.unexplained_px)
            return edges if is_better else grey
        edges = self._fit(pixels, start, photometric=False, level=level)
        if edges is None:
            return None
        is_melted = self._are_melted(edges)
        is_noisy = edges.rms_px > self._limits.edges.noisy_px
        cells = self._limits.cells
        # The dimmer corners of small white cells are clipped less than their middle, which moves edges differently.
        is_blown = edges.blown > self._limits.edges.blown_share
        edges_from = cells.blown_px if is_blown else cells.mixed_px
        if not is_melted and not is_noisy and self._photo.prints.cell_px(edges) >= edges_from:
            return edges
        # Edges that melted lie; others have found the place, from which a few steps are left.
        grey = self._fit_from(pixels, start if is_melted else edges, (edges.blur_px or 0.0) / HALF_WIDTH, level)
        if grey is None:
            return edges
        if self._photo.explains(grey) and grey.unexplained_px <= most:
            return grey
        if not is_melted or (edges.rms_px < self._limits.edges.located_px and not self._photo.resembles(grey)):
            # Something lies over the print.
            return edges
        # A streak that is not the same all over the print, or a fit that has not got there: neither is sure.
        return self._with_contradiction(edges, grey)

    def is_small(self, pose: Pose) -> bool:
        """Whether cells are so small that grey values measure the target, alone or after edges."""
        return self._photo.prints.cell_px(pose) < self._limits.cells.mixed_px

    def _wants_photometric(self, start: Pose) -> bool:
        is_steep = self._photo.prints.looked_at(start)[2] > self._limits.cells.edges_up_to
        return is_steep or self._has_small_cells(start)

    def _has_small_cells(self, start: Pose) -> bool:
        return self._photo.prints.cell_px(start) < self._limits.cells.photometric_px

    def _are_melted(self, pose: Pose) -> bool:
        """Whether the edges of a fit have run into their neighbours, which shifts them and makes others.

        They leave a residual then that a sharp image does not leave. A streak that is longer than the cells hides how
        wide the edges are, but not all of them agree.
        """
        limits, cell_px = self._limits, self._photo.prints.cell_px(pose)
        if pose.widest_px is None or pose.ragged_px is None or pose.ragged_px < limits.edges.clean_px:
            return False
        is_torn = pose.inliers < limits.agreement.whole and cell_px < limits.cells.small_px
        return is_torn or cell_px < limits.cells.melted_widths * pose.widest_px

    def _with_contradiction(self, pose: Pose, other: Pose) -> Pose:
        """The pose, as uncertain as another measurement of the same image that contradicts it is far away."""
        turned = np.asarray(cv2.Rodrigues(other.rotation @ pose.rotation.T)[0], dtype=np.float64).ravel()
        apart = np.concatenate([other.position - pose.position, turned])
        distance2 = float(apart @ np.linalg.solve(pose.covariance + other.covariance, apart))
        doubt = distance2 if distance2 > self._limits.photo.same_mahalanobis2 else 1.0
        return replace(pose, covariance=doubt * pose.covariance)

    def _fit_from(self, pixels: Grey, start: Pose, blur_px: float, level: Level | None = None) -> Pose | None:
        """Fit grey values from a point spread that is known nearly."""
        fitted = self._photo.fit(pixels, start, MIXED_STEPS, level, blur_px)
        return fitted if fitted is not None and np.isfinite(fitted.rms_px) else None

    def _fit(self, pixels: Grey, start: Pose, *, photometric: bool, level: Level | None = None) -> Pose | None:
        if not photometric:
            return self._edges.fit(pixels, start, level=level)
        fitted = self._photo.fit(pixels, start, level=level)
        return fitted if fitted is not None and np.isfinite(fitted.rms_px) else None

    def match(self, pixels: Grey, pose: Pose) -> float | None:
        """How well the image shows the target where the pose puts it, -1 to 1; none when it cannot be told."""
        read = self._bits.correlation(pixels, pose)
        if read is None or pose.source == "photometric":
            return pose.match if pose.match is not None else read
        return read

    def shows(self, pixels: Grey, start: Pose) -> bool:
        """Whether the image shows the target where a start puts it, well enough for a fit to find its place.

        What cannot be told counts as shown: nothing speaks against the start.
        """
        read = self._bits.correlation(pixels, start)
        return read is None or read >= self._limits.read.start_match

    def cell_evidence(self, pixels: Grey, pose: Pose) -> CellEvidence:
        """What the cells say about where a pose puts the target, and about places some whole cells beside."""
        return self._bits.evidence(pixels, pose)

    def is_supported(self, pixels: Grey, pose: Pose) -> bool:
        """Whether the edges that are seen support a pose with parts of the target hidden."""
        evidence = self._evidence.measure(pixels, pose)
        return evidence is not None and evidence.supports(self._limits.evidence)

    def explains_seen_edges(self, pixels: Grey, pose: Pose) -> bool:
        """Whether the edges that are seen lie where a pose puts them, however many are hidden."""
        evidence = self._evidence.measure(pixels, pose)
        return evidence is not None and evidence.agreeing >= self._limits.evidence.agreeing_beside

    def fit_mirrored(self, pixels: Grey, pose: Pose) -> Pose | None:
        """Fit the rival of a pose: the same place, the normal mirrored about the line of sight.

        Returns:
            The rival, which may be `pose` again; none when it fits nothing.
        """
        origin, toward, tilt = self._photo.prints.looked_at(pose)
        axis = np.cross(pose.rotation[:, 2], toward)
        turned = np.asarray(cv2.Rodrigues(axis / max(float(np.linalg.norm(axis)), 1e-9) * 2 * tilt)[0]) @ pose.rotation
        start = replace(pose, rotation=turned, position=pose.rotation @ origin + pose.position - turned @ origin)
        start = self._gatherer.gathered(pixels, start)
        # Losses compare only between fits of one kind, so the rival gets that of the pose.
        if pose.source == "photometric" and not self._wants_photometric(pose):
            return self._fit_from(pixels, start, pose.blur_px or 0.0)
        return self._fit(pixels, start, photometric=pose.source == "photometric")

    def fit_grey_values(self, pixels: Grey, rivals: Sequence[Pose]) -> list[Pose]:
        """Fit rivals of a small tag once more on all its pixels; empty when one of them cannot be."""
        fitted = [self._fit(pixels, rival, photometric=True) for rival in rivals]
        return [pose for pose in fitted if pose is not None] if all(fitted) else []

    def window(self, pose: Pose, shape: tuple[int, ...]) -> tuple[int, int, int, int] | None:
        """Part of the image `(x0, y0, x1, y1)` [px] that holds the target with room to spare."""
        seen, visible = self._projection.project(self._outline @ pose.rotation.T + pose.position)
        if not bool(visible.any()):
            return None
        low, high = seen[visible].min(axis=0), seen[visible].max(axis=0)
        room = ROOM * float((high - low).max()) + ROOM_PX
        x0, y0 = np.maximum(low - room, 0).astype(int)
        x1, y1 = np.minimum(high + room + 1, [shape[1], shape[0]]).astype(int)
        if not bool(visible.all()):
            return 0, 0, shape[1], shape[0]
        return (
            (int(x0), int(y0), int(x1), int(y1)) if min(x1 - x0, y1 - y0) >= self._limits.search.min_window_px else None
        )

    def side_px(self, pose: Pose) -> float:
        """Side of the largest tag in the image [px]."""
        return float(self._projection.focal[0]) * self.target.tags[0].size / max(float(pose.position[2]), NEAR_M)

    def disagreement(self, pose: Pose, tags: Sequence[tuple[Tag, Detection]]) -> float:
        """Largest mean corner distance between decoded tags and where the pose puts them [cells of the tag]."""
        worst = 0.0
        for tag, found in tags:
            seen, visible = self._projection.project(tag.corners @ pose.rotation.T + pose.position)
            if not bool(visible.all()):
                return float("inf")
            distance = float(np.linalg.norm(seen - found.corners, axis=1).mean())
            worst = max(worst, distance / max(found.side_px / tag.family.size_cells, 1.0))
        return worst

    def shows_whole_tag(self, pose: Pose, shape: tuple[int, ...]) -> bool:
        """Whether any tag lies in the image with all its corners, large enough to be decoded."""
        for tag in self.target.tags:
            seen, visible = self._projection.project(tag.corners @ pose.rotation.T + pose.position)
            inside = (seen > WHOLE_ROOM_PX) & (seen < np.array([shape[1], shape[0]]) - 1 - WHOLE_ROOM_PX)
            least = DECODED_CELL_PX * len(tag.bitmap)
            if bool(visible.all()) and bool(inside.all()) and float(np.ptp(seen, axis=0).min()) > least:
                return True
        return False
