"""Pose refinement on the black-white edges of a known target.

Every edge between cells (borders, bits, nested tags) is sampled; each sample is located along its normal to a fraction
of a pixel, and a robust Gauss-Newton step moves the pose. No closed quad is needed, so hidden or cut parts only take
samples away, and the normal matrix gives the covariance. Best from four pixels a cell upwards.

Source: model-edge tracking, Drummond and Cipolla, PAMI 24(7), 2002; Tukey weights, Holland and Welsch 1977.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.pose import Pose, median, turn
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.tags.cellread import SATURATED
from mkdaemon.vision.tags.tagmap import Tag, Target

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

TUKEY = 4.685
"""95 % efficiency on Gaussian residuals."""
REACH_PX = (24.0, 6.0, 3.0, 2.5)
"""How far along the normal an edge may be, per iteration [px]; never more than `REACH_CELLS`."""
REACH_CELLS = 0.5
"""The same in cells: half way to the neighbouring edge."""
MAX_SAMPLES = 320
STEP_PX = 0.5
"""Distance of the samples along a normal [px]; more while the reach is long."""
SETTLED_PX = 0.08
"""A step that moves no sample farther than this ends the fit [px]."""
MIN_CELL_PX = 2.2
"""Cells smaller than this along the normal blur into their neighbours [px]."""
CORRELATION = 1.0
"""Variance factor for neighbouring samples that share pixels; chosen so that NEES is 1 on development images."""
LOCATED_PX = 0.3
"""Error of a located edge in a bad image, against which prior knowledge is weighed [px]."""
SHARP_PX = 1.75
"""Half width of an edge in focus and at rest [px]."""
GLARE_PX = 2.0
"""How far beside an edge a highlight has to reach to hide it [px]."""
MISSED_PX = 0.6
"""What a sample that found no edge, or a wrong one, costs when rival poses are compared [px]."""
SHARPEST_PX = 0.02
"""Residuals below this are equally good when rival poses are compared [px]."""
SYSTEMATIC_PX = 0.01
"""Interpolation error of a located edge that does not average out [px]."""


@dataclass(frozen=True, slots=True, eq=False)
class EdgeModel:
    """Samples on the edges of a target.

    Attributes:
        points: `(n, 3)` [m; target].
        normals: towards the brighter side, unit `(n, 3)` [target].
        cell: side of the cell at each sample `(n,)` [m].
        tag: index of the tag of each sample `(n,)`.
        side: 0-3 for samples on the border (top, right, bottom, left), -1 inside `(n,)`.
    """

    points: Array
    normals: Array
    cell: Array
    tag: npt.NDArray[np.intp]
    side: npt.NDArray[np.intp]

    @classmethod
    def of(cls, target: Target, per_cell: int = 3) -> EdgeModel:
        """Sample every visible edge of a target `per_cell` times a cell."""
        parts = [_tag_edges(tag, per_cell) for tag in target.tags]
        points = np.concatenate([tag.place(part[0]) for tag, part in zip(target.tags, parts, strict=True)])
        normals = np.concatenate(
            [part[1] @ tag.rotation[:, :2].T for tag, part in zip(target.tags, parts, strict=True)]
        )
        index = np.concatenate([np.full(len(part[0]), k) for k, part in enumerate(parts)])
        cell = np.array([tag.module for tag in target.tags])[index]
        side = np.concatenate([part[2] for part in parts])
        keep = np.ones(len(points), dtype=bool)
        for k, tag in enumerate(target.tags):
            keep &= ~((index < k) & covered(points, tag))
        return cls(points[keep], normals[keep], cell[keep], index[keep], side[keep])


def covered(points: Array, tag: Tag) -> npt.NDArray[np.bool_]:
    """Which points `(n, 3)` [m; target] lie under the paper of a tag in the same plane."""
    local = (points - tag.position) @ tag.rotation
    half = tag.paper / 2 + 0.3 * tag.module
    under: npt.NDArray[np.bool_] = (np.abs(local[:, 2]) < tag.module) & (np.abs(local[:, :2]).max(axis=1) <= half)
    return under


def _tag_edges(tag: Tag, per_cell: int) -> tuple[Array, Array, npt.NDArray[np.intp]]:
    """Points, normals `(n, 2)` in the tag's plane and border sides `(n,)`."""
    n = tag.family.black_cells
    bright = np.pad((tag.bitmap > 0).astype(np.int8), 1, constant_values=1)
    along = 0.15 + 0.7 * (np.arange(per_cell) + 0.5) / per_cell
    points: list[Array] = []
    normals: list[Array] = []
    sides: list[npt.NDArray[np.intp]] = []
    for axis in (0, 1):
        # Differences along x (axis 0) and, on the transposed grid, along y; row 0 is the top, where y is positive.
        grid = bright if axis == 0 else bright.T
        rise = grid[1:-1, 1:].astype(int) - grid[1:-1, :-1]
        line, place = np.nonzero(rise)
        sign = rise[line, place].astype(np.float64)
        across = np.repeat(place.astype(np.float64), per_cell)
        run = (line[:, None] + along[None, :]).ravel()
        sign = np.repeat(sign, per_cell)
        side = np.where(across == 0, 3 if axis == 0 else 0, np.where(across == n, 1 if axis == 0 else 2, -1))
        if axis == 0:
            points.append(np.column_stack([across, run]))
            normals.append(np.column_stack([sign, np.zeros_like(sign)]))
        else:
            points.append(np.column_stack([run, across]))
            normals.append(np.column_stack([np.zeros_like(sign), -sign]))
        sides.append(side.astype(np.intp))
    cells_xy = np.concatenate(points)
    plane = np.column_stack([cells_xy[:, 0] - n / 2, n / 2 - cells_xy[:, 1]]) * tag.module
    return plane, np.concatenate(normals), np.concatenate(sides)


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """What is known about the direction of a target's normal.

    Attributes:
        up: vertical `(3,)` [camera].
        spread: standard deviation, each axis [rad].
    """

    up: Array
    spread: float

    def pull(self, rotation: Array) -> tuple[Array, Array]:
        """Normal matrix `(6, 6)` and right side `(6,)`, in units of a located edge's variance."""
        normal = rotation[:, 2]
        error = np.cross(normal, self.up)
        across = np.eye(3) - np.outer(normal, normal)
        weight = (LOCATED_PX / self.spread) ** 2
        matrix, right = np.zeros((6, 6)), np.zeros(6)
        matrix[3:, 3:] = weight * across
        right[3:] = weight * error
        return matrix, right


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Projected samples of one iteration."""

    index: npt.NDArray[np.intp]
    pixels: Array
    normals: Array
    reach: Array
    jacobian: Array


@dataclass(frozen=True, slots=True, eq=False)
class LocatedEdges:
    """Edges of one image around a pose.

    Attributes:
        index: which samples of the model are in view `(n,)`.
        offsets: of the edges from where the pose puts them `(n,)` [px], towards the bright side.
        found: whether an edge of the right sense was found `(n,)`.
        jacobian: of the offsets by pose `(n, 6)`.
    """

    index: npt.NDArray[np.intp]
    offsets: Array
    found: npt.NDArray[np.bool_]
    jacobian: Array


class EdgeFit:
    """Fits the pose of one target."""

    def __init__(self, target: Target, projection: Projection, max_samples: int = MAX_SAMPLES) -> None:
        self.model = EdgeModel.of(target)
        self._projection = projection
        self._max_samples = max_samples

    def fit(
        self,
        pixels: Grey,
        start: Pose,
        iterations: int = 6,
        level: Level | None = None,
        stretch_sd: float = 0.0,
    ) -> Pose | None:
        """Refine a pose.

        Args:
            pixels: `(h, w)` uint8.
            start: within about half a cell of the truth.
            iterations: Gauss-Newton steps at most.
            level: where the target's normal should point; edges of something lying over the target, which a free fit
                would follow, then become outliers.
            stretch_sd: how well the ratio of the focal lengths is known; the fit weighs the image against it and the
                covariance holds what stays unknown. Zero takes the calibration as exact.

        Returns:
            The pose, or none when too few edges were seen or the fit ran away.
        """
        rotation, position = start.rotation, start.position
        fitted: Pose | None = None
        projection, stretch = self._projection, 0.0
        for k in range(iterations):
            reach = REACH_PX[min(k, len(REACH_PX) - 1)]
            samples = self._project(pixels.shape, rotation, position, reach, projection)
            if samples is None:
                return None
            samples = _unglared(pixels, samples)
            offsets, good, width = _locate(pixels, samples)
            if int(good.sum()) < 12:
                return None
            pull = level.pull(rotation) if level is not None else (np.zeros((6, 6)), np.zeros(6))
            if stretch_sd > 0.0:
                samples, pull = _with_stretch(samples, pull, projection, stretch, stretch_sd)
            step, weights, normal = _robust_step(samples.jacobian, offsets, good, 0.15 if k == 0 else 0.02, pull)
            rotation = turn(rotation, step[3:6])
            position = position + step[:3]
            if not np.isfinite(position).all() or position[2] < NEAR_M:
                return None
            if np.linalg.norm(position - start.position) > 0.2 * start.range_m + 0.02:
                return None
            moved = median(np.abs(samples.jacobian @ step))
            fitted = _pose(rotation, position, samples, offsets, step, weights, normal, width)
            if moved < SETTLED_PX and reach <= REACH_PX[-2]:
                break
            if stretch_sd > 0.0:
                stretch += float(step[6])
                projection = self._projection.stretched(stretch)
        if fitted is not None and stretch_sd > 0.0:
            fitted = replace(fitted, stretch=stretch)
        return fitted

    def locate(self, pixels: Grey, pose: Pose) -> LocatedEdges | None:
        """Find the edges around a fitted pose; none when too few are in view."""
        samples = self._project(pixels.shape, pose.rotation, pose.position, REACH_PX[-1], self._projection)
        if samples is None:
            return None
        offsets, found, _ = _locate(pixels, samples)
        return LocatedEdges(samples.index, offsets, found, samples.jacobian)

    def _project(
        self, shape: tuple[int, ...], rotation: Array, position: Array, reach: float, projection: Projection
    ) -> _Samples | None:
        model = self.model
        seen = model.points @ rotation.T + position
        uv, visible = projection.project(seen)
        tips, tips_visible = projection.project(seen + (model.normals * (0.1 * model.cell)[:, None]) @ rotation.T)
        direction = tips - uv
        length = np.sqrt((direction * direction).sum(axis=1))
        cell_px = 10.0 * length
        edge = np.minimum(reach, REACH_CELLS * cell_px) + 1.0
        height, width = shape
        visible &= tips_visible & (cell_px > MIN_CELL_PX)
        visible &= (
            (uv[:, 0] > edge) & (uv[:, 1] > edge) & (uv[:, 0] < width - 1 - edge) & (uv[:, 1] < height - 1 - edge)
        )
        # Facing away: the sight line and the normal of the paper disagree only for targets of several planes.
        index = np.flatnonzero(visible)
        if len(index) < 12:
            return None
        if len(index) > self._max_samples:
            index = index[np.linspace(0, len(index) - 1, self._max_samples).astype(np.intp)]
        normals = direction[index] / length[index, None]
        jacobian = np.einsum("ni,nij->nj", normals, projection.pose_jacobian(seen[index], position))
        return _Samples(index, uv[index], normals, np.minimum(reach, REACH_CELLS * cell_px[index]), jacobian)


def _with_stretch(
    samples: _Samples, pull: tuple[Array, Array], projection: Projection, stretch: float, spread: float
) -> tuple[_Samples, tuple[Array, Array]]:
    """A seventh unknown, the ratio of the focal lengths, held by what the calibration knows about it."""
    column = (samples.normals * projection.stretch_jacobian(samples.pixels)).sum(axis=1)
    weight = (LOCATED_PX / spread) ** 2
    matrix, right = np.zeros((7, 7)), np.zeros(7)
    matrix[:6, :6], right[:6] = pull
    matrix[6, 6], right[6] = weight, -weight * stretch
    return replace(samples, jacobian=np.column_stack([samples.jacobian, column])), (matrix, right)


def _unglared(pixels: Grey, samples: _Samples) -> _Samples:
    """Leave out what lies wholly in a highlight: nothing is seen there, for a pose or against it.

    Where the paper itself is blown everything stays: a missing edge speaks against a pose then as ever.
    """
    near = np.minimum(samples.reach, GLARE_PX)[:, None] * samples.normals
    columns, rows = np.rint(np.stack([samples.pixels - near, samples.pixels, samples.pixels + near])).astype(np.intp).T
    grey = pixels[rows, columns] >= SATURATED
    blind = grey.all(axis=1)
    if not bool(blind.any()) or float(grey[~blind, 2].mean() if not bool(blind.all()) else 1.0) > 0.5:
        return samples
    seeing = ~blind
    return _Samples(*(getattr(samples, part.name)[seeing] for part in fields(samples)))


def _locate(pixels: Grey, samples: _Samples) -> tuple[Array, npt.NDArray[np.bool_], float]:
    """Find each edge along its normal.

    Returns:
        Offsets `(n,)` [px] towards the bright side, whether an edge of the right sense was found, and the width of the
        edges [px].
    """
    longest = float(samples.reach.max())
    spacing = max(STEP_PX, longest / 12.0)
    count = int(np.ceil((longest + 1.0) / spacing))
    along = np.arange(-count, count + 1) * spacing
    x = (samples.pixels[:, :1] + samples.normals[:, :1] * along).astype(np.float32)
    y = (samples.pixels[:, 1:] + samples.normals[:, 1:] * along).astype(np.float32)
    profile = cv2.remap(pixels, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    place = along[1:-1].astype(np.float32)
    slope = profile[:, 2:] - profile[:, :-2]
    np.maximum(slope, 0.0, out=slope)
    slope *= np.abs(place) <= samples.reach[:, None] + 0.25
    peak_at = slope.argmax(axis=1)
    peak = slope[np.arange(len(slope)), peak_at]
    # Half width of an edge in this image: the area of the slope over its peak; wide when out of focus or moving.
    width = min(max(0.9 * median(slope.sum(axis=1) * spacing / np.maximum(peak, 1e-3)), SHARP_PX), 8.0)
    centre = place[peak_at]
    window = np.abs(place - centre[:, None]) <= width
    if width > SHARP_PX + 0.01:
        body = np.where(window, np.maximum(slope - 0.25 * peak[:, None], 0.0), 0.0)
        centre = (body * place).sum(axis=1) / np.maximum(body.sum(axis=1), 1e-6)
        window = np.abs(place - centre[:, None]) <= width
    body = np.where(window, np.maximum(slope - 0.15 * peak[:, None], 0.0), 0.0)
    offsets = (body * place).sum(axis=1) / np.maximum(body.sum(axis=1), 1e-6)
    tenth = max(len(peak) // 10, 1)
    enough = max(2.5, 0.15 * float(np.partition(peak, -tenth)[-tenth]))
    good = (peak > enough) & (np.abs(offsets) < samples.reach)
    return offsets.astype(np.float64), good, width


def _robust_step(
    jacobian: Array, offsets: Array, good: npt.NDArray[np.bool_], least_scale: float, pull: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Three rounds of Tukey-weighted least squares over `k` unknowns: step `(k,)`, weights `(n,)`, normal `(k, k)`."""
    unknowns = jacobian.shape[1]
    step: Array = np.zeros(unknowns)
    weights: Array = good.astype(np.float64)
    normal = np.eye(unknowns)
    for _ in range(3):
        residual = offsets - jacobian @ step
        spread = max(1.4826 * median(np.abs(residual[good])), least_scale)
        inside = good & (np.abs(residual) < TUKEY * spread)
        weights[:] = np.where(inside, (1.0 - (residual / (TUKEY * spread)) ** 2) ** 2, 0.0)
        weighted = jacobian * weights[:, None]
        normal = weighted.T @ jacobian + pull[0]
        damping = 1e-9 * np.diag(np.diag(normal)) + 1e-12 * np.eye(unknowns)
        step[:] = np.linalg.solve(normal + damping, weighted.T @ offsets + pull[1])
    return step, weights, normal


def _pose(
    rotation: Array,
    position: Array,
    samples: _Samples,
    offsets: Array,
    step: Array,
    weights: Array,
    normal: Array,
    width: float,
) -> Pose:
    residual = offsets - samples.jacobian @ step
    missed = np.where(weights > 0.0, residual, MISSED_PX)
    total = float(weights.sum())
    variance = float((weights * residual**2).sum()) / max(total - 6.0, 1.0)
    counted = weights > 0.1
    information = normal + 1e-9 * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(normal))
    # In a blurred image neighbours share pixels over the width of the blur.
    covariance = (CORRELATION * width / SHARP_PX * variance + SYSTEMATIC_PX**2) * np.linalg.inv(information)[:6, :6]
    return Pose(
        rotation,
        position,
        (covariance + covariance.T) / 2,
        "edges",
        int(counted.sum()),
        float(np.sqrt(variance)),
        float(counted.mean()),
        float(np.linalg.norm(step[:3])) / max(float(np.linalg.norm(position)), 1e-9),
        loss=float(np.exp(np.mean(np.log(np.minimum(np.abs(missed), MISSED_PX) ** 2 + SHARPEST_PX**2)))),
        blur_px=width,
    )
