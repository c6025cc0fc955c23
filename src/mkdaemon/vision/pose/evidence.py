"""Whether the edges of a partly hidden target support a pose, or could be faked by what lies over it.

A first pose without attitude has nothing to contradict it but its own image. Two questions tell a right pose from one
that follows the rim of something lying on the print: do the edges agree whose cells are seen, and does the pose stay
where it is when any one straight line of edges is taken away? A rim is straight and covers one line of the grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS, EvidenceLimits, Limits
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.edgemodel import EdgeModel
from mkdaemon.vision.pose.edgestep import MAD
from mkdaemon.vision.pose.pose import Pose, median
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.cellread import sample
from mkdaemon.vision.tags.tagmap import Target

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

ALL_SAMPLES = 4000
"""More than any target has: which edges are hidden is asked of all of them."""
CLEAR_PERCENT = 75
"""Percentile of the contrast that the clear edges have."""
HALF_WAY = 0.5
"""Between two axes of a tag: which one a normal follows."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the edges say about a pose.

    Attributes:
        seen: share of the edges in view with the print's contrast.
        agreeing: share of these that lie where the pose puts them.
        leverage: largest turn of the pose when one straight line of edges is taken away [rad].
    """

    seen: float
    agreeing: float
    leverage: float

    def supports(self, limits: EvidenceLimits) -> bool:
        """Whether the pose can be believed with parts of the target hidden."""
        agrees = self.seen >= limits.min_seen and self.agreeing >= limits.min_agreeing
        return agrees and self.leverage <= limits.max_leverage


class EdgeEvidence:
    """Asks the edges of one target."""

    def __init__(self, target: Target, projection: Projection, limits: Limits = LIMITS) -> None:
        self._projection = projection
        self._limits = limits.evidence
        self._fit = EdgeFit(target, projection, ALL_SAMPLES, limits)
        model = self._fit.model
        reach = 0.5 * model.cell[:, None] * model.normals
        self._dark, self._bright = model.points - reach, model.points + reach
        self._line = _lines(target, model)

    def measure(self, pixels: Grey, pose: Pose) -> Evidence | None:
        """Ask all edges about a fitted pose; none when too few are in view.

        Args:
            pixels: `(h, w)` uint8.
            pose: fitted to edges.
        """
        located = self._fit.locate(pixels, pose)
        if located is None or not bool(located.found.any()):
            return None
        index = located.index
        contrast = self._grey(pixels, self._bright[index], pose) - self._grey(pixels, self._dark[index], pose)
        clear = max(float(np.percentile(contrast, CLEAR_PERCENT)), 1.0)
        seen = contrast > self._limits.seen_contrast * clear
        size = np.abs(located.offsets)
        scatter = max(MAD * median(size[located.found]), self._limits.least_scale_px)
        agrees = located.found & (size < self._limits.outlier * scatter)
        return Evidence(
            float(seen.mean()),
            float((agrees & seen).sum()) / max(int(seen.sum()), 1),
            _leverage(located.jacobian[agrees], located.offsets[agrees], self._line[index][agrees]),
        )

    def _grey(self, pixels: Grey, points: Array, pose: Pose) -> Array:
        seen, _ = self._projection.project(points @ pose.rotation.T + pose.position)
        return sample(pixels, seen)


def _lines(target: Target, model: EdgeModel) -> npt.NDArray[np.intp]:
    """Number of the straight line of the print each sample lies on `(n,)`."""
    keys: list[tuple[int, int, int]] = []
    for point, normal, cell, k in zip(model.points, model.normals, model.cell, model.tag.tolist(), strict=True):
        tag = target.tags[k]
        axis = int(abs(float(normal @ tag.rotation[:, 1])) > HALF_WAY)
        keys.append((k, axis, round(2 * float((point - tag.position) @ tag.rotation[:, axis]) / float(cell))))
    number = {key: k for k, key in enumerate(sorted(set(keys)))}
    return np.array([number[key] for key in keys], dtype=np.intp)


def _leverage(jacobian: Array, offsets: Array, line: npt.NDArray[np.intp]) -> float:
    """Largest turn [rad] that leaving out the samples of one line gives, to first order.

    Without the rows L of a line the least-squares pose moves by (J^T J - L^T L)^-1 L^T d_L.
    """
    normal = jacobian.T @ jacobian
    largest = 0.0
    for k in np.unique(line):
        part = jacobian[line == k]
        left = normal - part.T @ part
        step = np.linalg.solve(left + 1e-9 * np.diag(np.diag(normal)) + 1e-12 * np.eye(6), part.T @ offsets[line == k])
        largest = max(largest, float(np.linalg.norm(step[3:])))
    return largest
