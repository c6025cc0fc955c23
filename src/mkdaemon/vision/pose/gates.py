"""What a fitted pose has to pass before anybody hears of it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.pose.pose import Pose, correlation, largest_variance
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import exposed
from mkdaemon.vision.tags.cellread import sample
from mkdaemon.vision.tags.tagmap import Target, covered


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """The cells of one tag.

    Attributes:
        points: their middles `(n, 3)` [m; target].
        is_white: which of them are `(n,)`.
        cell: side of a cell [m].
        pairs: neighbours, the black one first `(m, 2)`.
        steps: to where the tag would lie whole cells beside its place `(k, 3)` [m; target]; the first is none.
    """

    points: Array
    is_white: Bools
    cell: float
    pairs: npt.NDArray[np.intp]
    steps: Array


@dataclass(frozen=True, slots=True)
class CellEvidence:
    """What the cells of a target say about a pose.

    Attributes:
        here: for it, of the tag that says most [nats]; minus infinity where no cells are in view.
        beside: for a place some whole cells beside, by how much more, of the tag for which that is most [nats].
    """

    here: float
    beside: float


class BitModel:
    """The cells of a target, to be compared with an image."""

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        self._readable_px = LIMITS.cells.readable_px
        cells = range(-LIMITS.read.beside_cells, LIMITS.read.beside_cells + 1)
        steps = np.array([(0.0, 0.0), *(step for step in product(cells, repeat=2) if any(step))])
        self._grids: list[_Grid] = []
        for k, tag in enumerate(target.tags):
            n = tag.family.black_cells
            value = np.pad(tag.bitmap > 0, 1, constant_values=True)
            row, column = (index.ravel() for index in np.indices(value.shape))
            placed = tag.place(np.column_stack([column - n / 2 - 0.5, n / 2 + 0.5 - row]) * tag.module)
            keep = ~(np.isin(row, (0, n + 1)) & np.isin(column, (0, n + 1)))
            for later in target.tags[k + 1 :]:
                keep &= ~covered(placed, later)
            number = np.full(value.shape, -1)
            number[keep.reshape(value.shape)] = np.arange(int(keep.sum()))
            pairs: list[npt.NDArray[np.intp]] = []
            for here, there in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
                for black, white in ((here, there), (there, here)):
                    usable = (number[black] >= 0) & (number[white] >= 0) & ~value[black] & value[white]
                    pairs.append(np.column_stack([number[black][usable], number[white][usable]]))
            moved = tag.place(steps * tag.module) - tag.place(steps[:1])
            is_white = value.ravel()[keep]
            self._grids.append(_Grid(placed[keep], is_white, tag.module, np.concatenate(pairs), moved))
        counts = [len(grid.points) for grid in self._grids]
        self._points = np.concatenate([grid.points for grid in self._grids])
        self._size = np.repeat([grid.cell for grid in self._grids], counts)
        starts = np.cumsum([0, *counts[:-1]])
        self._pairs = np.concatenate([grid.pairs + start for grid, start in zip(self._grids, starts, strict=True)])
        self._is_white = np.concatenate([grid.is_white for grid in self._grids])
        known = self._is_white - HALF
        plane = self._points / max(float(np.abs(self._points).max()), 1e-9)
        self._design = np.column_stack([np.ones_like(known), plane, known])

    def correlation(self, pixels: Grey, pose: Pose) -> float | None:
        """How well the image shows the known cells where the pose puts them.

        Returns:
            -1 to 1: the larger of the correlation after a lighting plane is taken out and of the agreement of
            neighbouring cells, which no shadow edge disturbs; none when too few cells are large enough to tell.
        """
        grey, visible = self._look(pixels, pose, self._points, self._size)
        if not bool(visible.any()):
            return None
        white, unblown = visible & self._is_white, grey < LIMITS.read.saturated
        count = np.count_nonzero(white)
        if np.count_nonzero(white & unblown) > HALF * count:
            # The paper is not blown: what is, lies in a highlight and says nothing about the cells below it.
            visible, white = visible & unblown, white & unblown
            count = np.count_nonzero(white)
        # Where a highlight floods both cells of a pair, it says nothing.
        pairs = self._pairs[unblown[self._pairs].any(axis=1)]
        seen, design = np.count_nonzero(visible), self._design
        if seen < LIMITS.read.min_cells or count in (0, seen):
            return None
        shown = grey
        if seen < len(grey):
            shown, design, pairs = grey[visible], design[visible], pairs[visible[pairs].all(axis=1)]
        normal = design.T @ design
        fitted = np.linalg.solve(normal + 1e-9 * seen * np.eye(len(normal)), design.T @ shown)
        even = correlation(shown - design[:, :-1] @ fitted[:-1], design[:, -1])
        if len(pairs) < LIMITS.read.min_cells:
            return even
        rise = grey[pairs[:, 1]] - grey[pairs[:, 0]]
        enough = max(NOISE_GREY, LIMITS.read.faint * float(np.abs(rise).mean()))
        return max(even, 2.0 * np.count_nonzero(rise > enough) / len(rise) - 1.0)

    def evidence(self, pixels: Grey, pose: Pose) -> CellEvidence:
        """What the cells say about where a pose puts the target, and about places some whole cells beside.

        After such a step edges agree with their neighbours', and where the rest of the tag is outside the image, little
        contradicts them. A pair of neighbouring cells in view says ln 2 (1 - e) for a place when it is read there, and
        ln 2 e when it is not: odds against a pair that is read by chance, with e misread in the right place. A tag that
        is hidden is read nowhere.
        """
        right, wrong = np.log(2.0 * (1.0 - LIMITS.read.misread)), np.log(2.0 * LIMITS.read.misread)
        here, beside = -np.inf, 0.0
        for grid in self._grids:
            points = (grid.points + grid.steps[:, None]).reshape(-1, 3)
            grey, visible = self._look(pixels, pose, points, grid.cell)
            grey, visible = grey.reshape(len(grid.steps), -1), visible.reshape(len(grid.steps), -1)
            both = visible[:, grid.pairs[:, 0]] & visible[:, grid.pairs[:, 1]]
            if not bool(both.any()):
                continue
            rise = grey[:, grid.pairs[:, 1]] - grey[:, grid.pairs[:, 0]]
            enough = max(NOISE_GREY, LIMITS.read.faint * float(np.abs(rise[both]).mean()))
            evidence = np.where(both, np.where(rise > enough, right, wrong), 0.0).sum(axis=1)
            here = max(here, float(evidence[0]))
            beside = max(beside, float(evidence.max() - max(evidence[0], 0.0)))
        return CellEvidence(here, beside)

    def _look(
        self, pixels: Grey, pose: Pose, points: Array, size: Array | float
    ) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Grey values `(n,)` where a pose puts points `(n, 3)` of cells of a size [m], and which can be read."""
        seen = (pose.rotation @ points.T + pose.position[:, None]).T
        seen, _ = exposed(seen, pose.motion, self._projection)
        uv, visible = self._projection.project(seen)
        height, width = pixels.shape
        depth = np.where(visible, seen[:, 2], 1.0)
        visible &= (uv[:, 0] > 1) & (uv[:, 1] > 1) & (uv[:, 0] < width - 2) & (uv[:, 1] < height - 2)
        visible &= size * float(self._projection.focal[0]) > self._readable_px * depth
        if bool(visible.all()):
            return sample(pixels, uv), visible
        grey = np.zeros(len(uv))
        if bool(visible.any()):
            grey[visible] = sample(pixels, uv[visible])
        return grey, visible


def fit_refusal(pose: Pose, cfg: TrackerSection) -> PoseRefusal | None:
    """What is wrong with a fit by itself; none when nothing is."""
    if pose.source == "corners":
        # Neither edges nor grey values found the target there; four corners alone vouch for nothing.
        return PoseRefusal.NO_FIT
    if pose.inliers < cfg.min_inlier_fraction:
        return PoseRefusal.INLIERS
    if pose.points < cfg.min_points:
        return PoseRefusal.POINTS
    if pose.unexplained_px > cfg.max_rms_px:
        return PoseRefusal.RESIDUAL
    if pose.step > cfg.max_step:
        return PoseRefusal.STEP
    return None


def certainty_refusal(
    pose: Pose, *, has_attitude: bool, is_plain: bool = False, is_backed: bool = False
) -> PoseRefusal | None:
    """Refuse poses whose own covariance or residual says they may be wrong; none when certain enough.

    Args:
        pose: measured.
        has_attitude: whether an attitude stands against it.
        is_plain: the target is large in the image and its cells are read clearly; hidden parts then mislead nobody.
        is_backed: the images before and inertia say the same; noise alone then may make the residual large.
    """
    certain = LIMITS.certainty
    if not has_attitude:
        # In a dark image the residual is large and yet nearly all points agree.
        noisy = is_backed and pose.source == "edges" and pose.inliers > LIMITS.agreement.whole
        if not noisy and pose.unexplained_px > certain.blind_rms_px:
            return PoseRefusal.RESIDUAL
        if pose.inliers < LIMITS.agreement.blind and not is_plain:
            return PoseRefusal.INLIERS
    variance = largest_variance(pose.covariance[3:, 3:])
    if not np.isfinite(variance) or variance > (certain.angle_sd if has_attitude else certain.blind_angle_sd) ** 2:
        return PoseRefusal.ANGLE_UNCERTAIN
    spread = float(np.sqrt(largest_variance(pose.covariance[:3, :3])))
    if spread > max(certain.wrong_m, certain.wrong_share * pose.range_m) / certain.deviations:
        return PoseRefusal.POSITION_UNCERTAIN
    return None
