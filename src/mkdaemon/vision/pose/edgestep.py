"""One robust Gauss-Newton step of a fit to edges, and what its residuals say about the pose it leads to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.bend import BENT, Bend, BentPrint
from mkdaemon.vision.pose.edgefind import LEAST_OF_A_KIND, FoundEdges, Samples
from mkdaemon.vision.pose.linetime import KnownMotion, SeenMotion
from mkdaemon.vision.pose.nuisance import Prior
from mkdaemon.vision.pose.pose import Pose, median

Numbers = npt.NDArray[np.intp]

MAD = 1.4826
"""Deviation of Gaussian residuals over their median absolute value."""
RIDGE, LEAST_RIDGE = 1e-9, 1e-12
"""Share of the normal matrix' diagonal that is added before it is inverted, and so much more: directions nobody sees
stay finite."""
LEAST_SLOPE = 0.3
"""Of the influence, over the mean weight: below, a robust estimate has no variance of its own (0.83 for Gaussian
residuals)."""
ROOMY = 0.5
"""Room of edges that tell how large residuals are."""
GIVES_WAY = (1.0 / 2.0, 3.0 / 4.0, 5.0 / 6.0)
"""Each term of the series of (1 - h)^-1/2 over h times the one before."""
ROUNDS = 3
"""Weights and step depend on each other: so often."""


@dataclass(frozen=True, slots=True, eq=False)
class EdgeStep:
    """One step over `k` unknowns, the pose first and the common shift last.

    Attributes:
        samples: with the derivative of their offsets by all unknowns.
        edges: where the image has them.
        change: of the unknowns `(k,)`.
        weights: of the samples `(n,)`, zero without an edge.
        normal: normal matrix with what is known beforehand `(k, k)`.
        residual: of the samples after the step `(n,)` [px].
        agreeing: Tukey's weights as if every edge were trusted: doubt makes no edge agree `(n,)`.
        slope: of the influence of each sample, d(w r) / dr `(n,)`: below w, and below zero near the bound.
    """

    samples: Samples
    edges: FoundEdges
    change: Array
    weights: Array
    normal: Array
    residual: Array
    agreeing: Array
    slope: Array

    @classmethod
    def solve(
        cls,
        samples: Samples,
        edges: FoundEdges,
        prior: Prior,
        *,
        is_near: bool = True,
    ) -> EdgeStep:
        """Rounds of weighted least squares.

        x = (J^T W J + P)^-1 (J^T W d + p) with Tukey's w = t (1 - (r / c sigma)^2)^2 inside c sigma, zero outside; t is
        the trust in an edge, times the clarity of a blown one, r holds its root; sigma from the median of |r|; P
        and p are the `prior`.

        Args:
            samples: of the edge model.
            edges: where the image has them.
            prior: of all unknowns.
            is_near: whether the fit is about in its place. Before, sigma is the larger one of the two ways that edges
                run: a start that is off along one side of the print leaves half of the edges in their place, which
                would outvote the other half.
        """
        jacobian, offsets, found = samples.jacobian, edges.offsets, edges.found
        change: Array = np.zeros(jacobian.shape[1])
        weights: Array = found.astype(np.float64)
        clear = np.sqrt(edges.room if edges.blown is None else edges.room * edges.blown.clear)
        sure = edges.trust * clear**2
        residual, normal, inside = offsets, prior[0], weights
        # Doubt of edges without room makes their residuals small: they would make those outliers that have it.
        roomy = found & (edges.room > ROOMY)
        telling = roomy if np.count_nonzero(roomy) >= LEAST_OF_A_KIND else found
        groups = (np.flatnonzero(telling),) if is_near else _kinds(telling, samples.upright)
        for _ in range(ROUNDS):
            size = np.abs(residual) * np.sqrt(sure)
            inside = np.maximum(1.0 - (size / (LIMITS.edges.tukey * _usual(size, groups))) ** 2, 0.0) * found
            weights = inside**2 * sure
            weighted = (jacobian * weights[:, None]).T
            normal = weighted @ jacobian + prior[0]
            change[:] = np.linalg.solve(damped(normal), weighted @ offsets + prior[1])
            residual = offsets - jacobian @ change
        # d(r (1 - u)^2) / dr with u = (r / bound)^2 is (1 - u) (1 - 5 u).
        slope = inside * (5.0 * inside - 4.0) * sure
        size = np.abs(residual) * clear
        agreeing = np.maximum(1.0 - (size / (LIMITS.edges.tukey * _usual(size, groups))) ** 2, 0.0) ** 2 * found
        return cls(samples, edges, change, weights, normal, residual, agreeing, slope)

    @property
    def variance(self) -> float:
        """Of a located edge [px^2]: sigma^2 = sum(w r^2) / (sum(w) - 6)."""
        return float(self.weights @ self.residual**2) / max(float(self.weights.sum()) - 6.0, 1.0)

    @property
    def length2(self) -> float:
        """Squared length of the pose's part of the step, in deviations that the edges leave."""
        spread = self.variance * np.linalg.inv(damped(self.normal))[:6, :6]
        return float(self.change[:6] @ np.linalg.solve(spread, self.change[:6]))

    @property
    def influence_variance(self) -> float:
        """Variance of an edge as the robust estimate feels it [px^2].

        An M-estimate with influence psi(r) = w r has the covariance sum(psi^2) / sum(psi')^2 over J^T J. With the
        normal matrix J^T W J in its place: v = (sum(psi^2) / sum(w)) (sum(w) / sum(psi'))^2. Source: Huber, Robust
        Statistics, 6.3. Where residuals crowd near the bound, psi' is small and v large.
        """
        total = float(self.weights.sum())
        felt = float(((self.weights * self.residual) ** 2).sum()) / max(total - 6.0, 1.0)
        return felt * (total / max(float(self.slope.sum()), LEAST_SLOPE * total)) ** 2

    def shared(self, square: npt.NDArray[np.intp], inverse: Array) -> float:
        """By how much errors that the samples of a square have in common raise the variance, by their residuals.

        With g_i = J_i w_i r_i, A the inverse normal matrix and G the sum of g over a square:
        sum(G^T A G) / sum(g^T A g), 1 for errors that have nothing in common. What falls on a print unevenly, as a
        shadow's rim does, moves neighbouring edges alike.

        A fit gives way to what its samples have in common, the more the fewer there are: the residuals of a square are
        (I - H)^-1/2 r, H = (w^1/2 J) A (w^1/2 J)^T among them. Source: covariance by clusters, Bell and McCaffrey,
        Survey Methodology 28(2), 2002; the root by the first terms of its series.
        """
        steep = self.samples.jacobian * np.sqrt(self.weights)[:, None]
        count = steep.shape[1]
        place = (count * square + np.arange(count)[:, None]).ravel()
        pulls = steep * (np.sqrt(self.weights) * self.residual)[:, None]
        alone = float(((pulls @ inverse) * pulls).sum())
        term = together = np.bincount(place, pulls.T.ravel()).reshape(-1, count)
        for ratio in GIVES_WAY:
            back = ratio * (steep * (term @ inverse)[square]).sum(axis=1)
            term = np.bincount(place, (steep * back[:, None]).T.ravel()).reshape(-1, count)
            together = together + term
        return float(((together @ inverse) * together).sum()) / max(alone, LEAST_RIDGE)

    def pose(
        self,
        rotation: Array,
        position: Array,
        square: npt.NDArray[np.intp],
        bent: BentPrint | None = None,
        edge_px: float = 1.0,
    ) -> Pose:
        """The pose after this step.

        Args:
            rotation: camera from target `(3, 3)`.
            position: of the target `(3,)` [m; RDF].
            square: of the print each sample of the model is in `(m,)`.
            bent: the bend of the print, where it is an unknown.
            edge_px: deviation of a located edge that the bend was weighed with [px].
        """
        limits, variance = LIMITS.edges, self.variance
        inverse = np.asarray(np.linalg.inv(damped(self.normal)), np.float64)
        # C = (v b + s^2) (J^T W J)^-1: b is what neighbours share by their residuals (blur makes v larger, not b); s is
        # what interpolation leaves and no number of samples averages out.
        noise = self._noise(square, inverse)
        bend = None
        if bent is not None:
            # What is known of the bend is no better for edges that are worse than they look.
            normal = self.normal.copy()
            normal[BENT, BENT] += (noise - edge_px**2) * bent.information
            inverse = np.asarray(np.linalg.inv(damped(normal)), np.float64)
            bend = Bend(bent.rise, noise * inverse[BENT, BENT])
        covariance = noise * inverse[:6, :6]
        if self.edges.unsure is not None:
            # What light may have moved are errors of all edges: each e moves the unknowns by N^-1 J^T W e.
            off = inverse[:6] @ ((self.samples.jacobian * self.weights[:, None]).T @ self.edges.unsure.T)
            covariance += off @ off.T
        if bent is not None and bend is not None:
            covariance[:3, :3] += bent.sheet.plane_covariance(rotation, bend)
        size = np.abs(self.residual)
        counted = self.agreeing > limits.counted
        return Pose(
            rotation,
            position,
            (covariance + covariance.T) / 2,
            "edges",
            int(counted.sum()),
            float(np.sqrt(variance)),
            float(self.edges.room[counted].sum() / self.edges.room.sum()),
            float(np.linalg.norm(self.change[:3])) / max(float(np.linalg.norm(position)), 1e-9),
            loss=self._loss(size),
            blur_px=self.edges.width,
            widest_px=self.edges.widest,
            ragged_px=MAD * max(median(size[kind]) for kind in _kinds(self.edges.found, self.samples.upright)),
            shift_px=float(self.change[-1]),
            blown=0.0 if self.edges.blown is None else self.edges.blown.share,
            bend=bend,
            known_bend=None if bent is None else bent.known,
        )

    def _noise(self, square: npt.NDArray[np.intp], inverse: Array) -> float:
        """Variance of an edge that a covariance is told with [px^2]."""
        shared = max(self.shared(square[self.samples.index], inverse), 1.0)
        return shared * self.influence_variance + LIMITS.edges.systematic_px**2

    def seen_motion(
        self,
        square: npt.NDArray[np.intp],
        block: slice,
        motion: Array,
        asked: KnownMotion,
        edge_px: float,
    ) -> SeenMotion:
        """What the image alone says about the motion: what the fit was told is taken out of what it found.

        With A the inverse normal matrix of the motion and W its prior: Lambda = A^-1 - W, pull = A^-1 m - W m0.

        Args:
            square: of the print each sample of the model is in `(m,)`.
            block: where the motion is among the unknowns.
            motion: found `(4,)`.
            asked: what the fit was told.
            edge_px: deviation of a located edge that this was weighed with [px].
        """
        inverse = np.asarray(np.linalg.inv(damped(self.normal)), np.float64)
        found = np.linalg.inv(inverse[block, block])
        given = (edge_px / asked.spread) ** 2
        values, axes = np.linalg.eigh(found - np.diag(given))
        noise = self._noise(square, inverse)
        information = (axes * np.maximum(values, 0.0)) @ axes.T / noise
        return SeenMotion(information, (found @ motion - given * asked.expected) / noise)

    def _loss(self, size: Array) -> float:
        """Loss for rivals: geometric mean of min(r, missed)^2 + least^2.

        Log odds of two fits are then n / 2 times the log of their ratio, and a hidden sample costs both the same.
        """
        missed = 2.0 * LIMITS.edges.located_px
        squared = np.where(self.agreeing > 0.0, np.minimum(size, missed), missed) ** 2 + LIMITS.edges.least_scale_px**2
        return float(np.exp(np.mean(np.log(squared))))


def _usual(size: Array, groups: Sequence[Numbers]) -> float:
    """The usual size of residuals by the sizes of all `(n,)` [px]: the larger median of groups."""
    return max(MAD * max(median(size[group]) for group in groups), LIMITS.edges.least_scale_px)


def _kinds(found: Bools, upright: Bools) -> tuple[Numbers, Numbers]:
    """What was found of the two ways that edges run; all, twice, where one has too few."""
    kinds = np.flatnonzero(found & upright), np.flatnonzero(found & ~upright)
    if min(len(kinds[0]), len(kinds[1])) >= LEAST_OF_A_KIND:
        return kinds
    every = np.flatnonzero(found)
    return every, every


def damped(normal: Array) -> Array:
    """A normal matrix `(k, k)` with its ridge."""
    found: Array = normal.copy()
    diagonal = found.reshape(-1)[:: len(found) + 1]
    diagonal += RIDGE * diagonal + LEAST_RIDGE
    return found
