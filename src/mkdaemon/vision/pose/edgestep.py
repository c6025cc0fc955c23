"""One robust Gauss-Newton step of a fit to edges, and what its residuals say about the pose it leads to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import Limits
from mkdaemon.vision.pose.edgefind import FoundEdges
from mkdaemon.vision.pose.nuisance import Prior
from mkdaemon.vision.pose.pose import Pose, median

Array = npt.NDArray[np.float64]

MAD = 1.4826
"""Deviation of Gaussian residuals over their median absolute value."""
RIDGE, LEAST_RIDGE = 1e-9, 1e-12
"""Share of the normal matrix' diagonal that is added before it is inverted, and so much more: directions nobody sees
stay finite."""
ROUNDS = 3
"""Weights and step depend on each other: so often."""


@dataclass(frozen=True, slots=True, eq=False)
class EdgeStep:
    """One step over `k` unknowns, the pose first and the common shift last.

    Attributes:
        change: of the unknowns `(k,)`.
        weights: of the samples `(n,)`, zero without an edge.
        normal: normal matrix with what is known beforehand `(k, k)`.
        residual: of the samples after the step `(n,)` [px].
        width: half width of the edges of this image [px].
    """

    change: Array
    weights: Array
    normal: Array
    residual: Array
    width: float

    @classmethod
    def solve(cls, jacobian: Array, edges: FoundEdges, least_scale: float, tukey: float, prior: Prior) -> EdgeStep:
        """Rounds of weighted least squares.

        x = (J^T W J + P)^-1 (J^T W d + p) with Tukey's w = (1 - (r / c sigma)^2)^2 inside c sigma, zero outside; sigma
        from the median of |r|; P and p are the `prior`.
        """
        offsets, found = edges.offsets, edges.found
        change: Array = np.zeros(jacobian.shape[1])
        weights: Array = found.astype(np.float64)
        residual, normal = offsets, prior[0]
        for _ in range(ROUNDS):
            bound = tukey * max(MAD * median(np.abs(residual[found])), least_scale)
            weights = np.maximum(1.0 - (residual * (1.0 / bound)) ** 2, 0.0) ** 2
            weights *= found
            weighted = (jacobian * weights[:, None]).T
            normal = weighted @ jacobian + prior[0]
            change[:] = np.linalg.solve(_damped(normal), weighted @ offsets + prior[1])
            residual = offsets - jacobian @ change
        return cls(change, weights, normal, residual, edges.width)

    @property
    def variance(self) -> float:
        """Of a located edge [px^2]: sigma^2 = sum(w r^2) / (sum(w) - 6)."""
        return float(self.weights @ self.residual**2) / max(float(self.weights.sum()) - 6.0, 1.0)

    def pose(self, rotation: Array, position: Array, all_limits: Limits) -> Pose:
        """The pose after this step.

        Args:
            rotation: camera from target `(3, 3)`.
            position: of the target `(3,)` [m; RDF].
            all_limits: thresholds.
        """
        limits, variance = all_limits.edges, self.variance
        # C = (sigma^2 b + s^2) (J^T W J)^-1: in a blurred image neighbours share pixels over b, the width of the blur
        # over that of a sharp edge; s is what interpolation leaves and no number of samples averages out.
        shared = self.width / all_limits.blur.sharp_px
        covariance = (shared * variance + limits.systematic_px**2) * np.linalg.inv(_damped(self.normal))[:6, :6]
        # Loss for rivals: geometric mean of min(r, missed)^2 + least^2. Log odds of two fits are then n / 2 times the
        # log of their ratio, and a hidden sample costs both the same.
        missed = np.where(self.weights > 0.0, np.abs(self.residual), limits.missed_px)
        squared = np.minimum(missed, limits.missed_px) ** 2 + limits.least_scale_px**2
        counted = self.weights > limits.counted
        return Pose(
            rotation,
            position,
            (covariance + covariance.T) / 2,
            "edges",
            int(counted.sum()),
            float(np.sqrt(variance)),
            float(counted.mean()),
            float(np.linalg.norm(self.change[:3])) / max(float(np.linalg.norm(position)), 1e-9),
            loss=float(np.exp(np.mean(np.log(squared)))),
            blur_px=self.width,
            shift_px=float(self.change[-1]),
        )


def _damped(normal: Array) -> Array:
    """A normal matrix with its ridge."""
    damped: Array = normal.copy()
    diagonal = np.einsum("ii->i", damped)
    diagonal += RIDGE * diagonal + LEAST_RIDGE
    return damped
