"""What a fitted pose has to pass before anybody hears of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import TrackerSection
from mkdaemon.vision.pose.edgefit import covered
from mkdaemon.vision.pose.pose import Pose, angle_between, correlation, largest_variance
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.cellread import SATURATED, sample
from mkdaemon.vision.tags.tagmap import Target

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

MIN_CELL_PX = 2.5
"""Cells smaller than this carry no bit evidence [px]."""
MIN_CELLS = 16
PAPER_SHARE = 0.2
"""Share of the white cells that has to be below that for the others to lie in a highlight."""
MAX_ANGLE_SD = np.radians(1.25)
"""A pose less certain than this is not published: four sd would be a wrong pose of 5 degrees [rad]."""
BLIND_INLIERS = 0.6
"""Share of agreeing points asked for while no attitude can contradict a fit."""
NOISY_INLIERS = 0.9
"""In a dark image the residual is large and yet nearly all points agree; hidden or smeared edges leave fewer."""
BLIND_ANGLE_SD = np.radians(0.9)
"""As `MAX_ANGLE_SD`, without attitude [rad]."""
BLIND_RMS_PX = 0.5
"""Residual above which a fit is not believed while no attitude can contradict it [px]."""
MAX_POSITION_SD = (0.0125, 0.0025)
"""Largest standard deviation that is published: metres, or this share of the range where that is more; four sd of the
first are a wrong pose of 5 cm."""
WIDE_PX = 3.0
"""Width of an edge from which its place depends on what the blur looks like [px]."""
WIDE_FACTOR = 1.7
"""On the deviation of a position from such edges: one NEES in twenty is above 4.4 in blurred images beyond 3 m."""

BLIND_GREY_RMS_PX = 0.15
"""The same for photometric fits, in pixels of edge shift: motion blur, which they do not model, shows here [px]."""


class BitModel:
    """The cells of a target, to be compared with an image."""

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        points: list[Array] = []
        bright: list[Array] = []
        size: list[Array] = []
        pairs: list[npt.NDArray[np.intp]] = []
        count = 0
        for k, tag in enumerate(target.tags):
            n = tag.family.black_cells
            value = np.pad(tag.bitmap > 0, 1, constant_values=True)
            row, column = (index.ravel() for index in np.indices(value.shape))
            plane = np.column_stack([column - n / 2 - 0.5, n / 2 + 0.5 - row]) * tag.module
            placed = tag.place(plane)
            keep = np.ones(len(placed), dtype=bool)
            for later in target.tags[k + 1 :]:
                keep &= ~covered(placed, later)
            corner = (np.isin(row, (0, n + 1))) & (np.isin(column, (0, n + 1)))
            keep &= ~corner
            number = np.full(value.size, -1)
            number[keep] = count + np.arange(int(keep.sum()))
            grid = number.reshape(value.shape)
            for a, b, va, vb in (
                (grid[:, :-1], grid[:, 1:], value[:, :-1], value[:, 1:]),
                (grid[:-1], grid[1:], value[:-1], value[1:]),
            ):
                usable = (a >= 0) & (b >= 0) & (va != vb)
                black_first = usable & ~va
                white_first = usable & va
                pairs.append(np.column_stack([a[black_first], b[black_first]]))
                pairs.append(np.column_stack([b[white_first], a[white_first]]))
            points.append(placed[keep])
            bright.append(value.ravel()[keep].astype(np.float64) - 0.5)
            size.append(np.full(int(keep.sum()), tag.module))
            count += int(keep.sum())
        self._points = np.concatenate(points)
        self._bright = np.concatenate(bright)
        self._size = np.concatenate(size)
        self._pairs = np.concatenate(pairs)
        self._plane = self._points / max(float(np.abs(self._points).max()), 1e-9)

    def correlation(self, pixels: Grey, pose: Pose) -> float | None:
        """How well the image shows the known cells where the pose puts them.

        Returns:
            -1 to 1: the larger of the correlation after a lighting plane is taken out and of the agreement of
            neighbouring cells, which no shadow edge disturbs; none when too few cells are large enough to tell.
        """
        seen = self._points @ pose.rotation.T + pose.position
        uv, visible = self._projection.project(seen)
        height, width = pixels.shape
        depth = np.where(seen[:, 2] > 1e-6, seen[:, 2], 1.0)
        visible &= (uv[:, 0] > 1) & (uv[:, 1] > 1) & (uv[:, 0] < width - 2) & (uv[:, 1] < height - 2)
        visible &= self._size * float(self._projection.focal[0]) > MIN_CELL_PX * depth
        if not bool(visible.any()):
            return None
        grey = np.zeros(len(uv))
        grey[visible] = sample(pixels, uv[visible])
        white = visible & (self._bright > 0)
        if float((grey[white] < SATURATED).mean() if bool(white.any()) else 0.0) > PAPER_SHARE:
            # The paper is not blown: what is, lies in a highlight and says nothing about the cells below it.
            visible &= grey < SATURATED
        if int(visible.sum()) < MIN_CELLS:
            return None
        known = self._bright[visible]
        if bool((known > 0).all()) or bool((known < 0).all()):
            return None
        design = np.column_stack([np.ones_like(known), self._plane[visible], known])
        normal = design.T @ design
        fitted = np.linalg.solve(normal + 1e-9 * len(known) * np.eye(len(normal)), design.T @ grey[visible])
        even = correlation(grey[visible] - design[:, :-1] @ fitted[:-1], known)
        both = visible[self._pairs].all(axis=1)
        if int(both.sum()) < MIN_CELLS:
            return even
        rise = grey[self._pairs[both, 1]] - grey[self._pairs[both, 0]]
        clear = rise > max(2.0, 0.1 * float(np.abs(rise).mean()))
        return max(even, 2.0 * float(clear.mean()) - 1.0)


def fit_fault(pose: Pose, cfg: TrackerSection) -> str:
    """Say what is wrong with a fit by itself; empty when nothing is."""
    if pose.source == "corners":
        return ""
    if pose.inliers < cfg.min_inlier_fraction:
        return "inliers"
    if pose.points < cfg.min_points:
        return "points"
    if pose.rms_px > cfg.max_rms_px:
        return "residual"
    if pose.step > cfg.max_step:
        return "step"
    return ""


def certainty_fault(pose: Pose, *, has_attitude: bool, is_plain: bool = False, is_backed: bool = False) -> str:
    """Refuse poses whose own covariance or residual says they may be wrong; empty when certain enough.

    Args:
        pose: measured.
        has_attitude: whether an attitude stands against it.
        is_plain: the target is large in the image and its cells are read clearly; hidden parts then mislead nobody.
        is_backed: the images before and inertia say the same; noise alone then may make the residual large.
    """
    if not has_attitude and pose.source != "corners":
        noisy = is_backed and pose.source == "edges" and pose.inliers > NOISY_INLIERS
        if not noisy and pose.rms_px > (BLIND_RMS_PX if pose.source == "edges" else BLIND_GREY_RMS_PX):
            return "residual"
        if pose.inliers < BLIND_INLIERS and not is_plain:
            return "inliers"
    variance = largest_variance(pose.covariance[3:, 3:])
    if not np.isfinite(variance) or variance > (MAX_ANGLE_SD if has_attitude else BLIND_ANGLE_SD) ** 2:
        return "angle_uncertain"
    spread = float(np.sqrt(largest_variance(pose.covariance[:3, :3])))
    if pose.source == "edges" and pose.blur_px is not None and pose.blur_px > WIDE_PX:
        spread *= WIDE_FACTOR
    if spread > max(MAX_POSITION_SD[0], MAX_POSITION_SD[1] * pose.range_m):
        return "position_uncertain"
    return ""


def innovation_fault(pose: Pose, predicted: Pose, age: float, *, has_attitude: bool, has_velocity: bool) -> str:
    """Compare a pose with the track's prediction.

    Args:
        pose: measured.
        predicted: by the track.
        age: time since the track's last pose [s].
        has_attitude: whether the prediction used the vehicle's attitude.
        has_velocity: whether it used a velocity.
    """
    # Without attitude a shaken camera turns by degrees between images; with it only the gyro error is left.
    angle = np.radians(6.0 if has_attitude else 8.0) + np.radians(60.0) * age
    if angle_between(pose.rotation, predicted.rotation) > angle:
        return "rotation_jump"
    # Shaking does not change the range; 1 m/s is what 30 m/s^2 add between two images.
    speed = 1.0 if has_velocity else 6.0
    if abs(pose.range_m - predicted.range_m) > 0.01 * predicted.range_m + speed * age:
        return "range_jump"
    centre = pose.rotation.T @ pose.position - predicted.rotation.T @ predicted.position
    reach = 0.05 * predicted.range_m + 4.0 * age + 0.35 * angle * predicted.range_m
    return "position_jump" if float(np.linalg.norm(centre)) > reach else ""
