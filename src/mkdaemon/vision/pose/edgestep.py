"""One robust Gauss-Newton step of a fit to edges, and what its residuals say about the pose it leads to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Bools
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.edgefind import LEAST_OF_A_KIND, FoundEdges, Numbers, kinds_of
from mkdaemon.vision.pose.edgemodel import Samples
from mkdaemon.vision.pose.pose import LEAST_RIDGE, Pose, inverted, length2, median
from mkdaemon.vision.pose.unknowns import POSE, Prior, State, Unknowns

MAD = 1.4826
"""Deviation of Gaussian residuals over their median absolute value."""
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
    """One step over `k` unknowns.

    Attributes:
        unknowns: of the offsets, the common shift last.
        samples: of the edge model.
        edges: where the image has them.
        change: of the unknowns `(k,)`.
        weights: of the samples `(n,)`, zero without an edge.
        normal: normal matrix with what is known beforehand `(k, k)`.
        expected: variance of a located edge that this was weighed with [px^2].
        residual: of the samples after the step `(n,)` [px].
        agrees: whether each lies where the pose puts it, by the larger median of both ways; trust has no say, as doubt
            makes no edge agree `(n,)`.
        slope: of the influence of each sample, d(w r) / dr `(n,)`: below w, and below zero near the bound.
    """

    unknowns: Unknowns
    samples: Samples
    edges: FoundEdges
    change: Array
    weights: Array
    normal: Array
    expected: float
    residual: Array
    agrees: Bools
    slope: Array

    @classmethod
    def solve(
        cls, unknowns: Unknowns, samples: Samples, edges: FoundEdges, expected: float, *, is_near: bool = True
    ) -> EdgeStep:
        """Rounds of weighted least squares.

        See `unknowns`, with Tukey's w = t (1 - (r / c sigma)^2)^2 inside c sigma, zero outside; t is the trust in an
        edge times its room, r holds its root; sigma from the median of |r|.

        Args:
            unknowns: of the offsets.
            samples: of the edge model.
            edges: where the image has them.
            expected: variance of a located edge [px^2].
            is_near: whether the fit is about in its place. Before, sigma is the larger one of the two ways that edges
                run: a start that is off along one side of the print leaves half of the edges in their place, which
                would outvote the other half.
        """
        offsets, found = edges.offsets, edges.found
        clear, sure = np.sqrt(edges.room), edges.trust * edges.room
        root = np.sqrt(sure)
        # Doubt of edges without room makes their residuals small: they would make those outliers that have it.
        roomy = found & (edges.room > ROOMY)
        telling = roomy if np.count_nonzero(roomy) >= LEAST_OF_A_KIND else found
        kinds = kinds_of(telling, samples.upright)
        usual = [np.flatnonzero(telling)] if is_near else kinds
        residual = offsets
        for _ in range(ROUNDS):
            inside = _inside(np.abs(residual) * root, usual) * found
            weights = inside**2 * sure
            normal, right = unknowns.equations(weights, offsets, expected)
            change = np.asarray(np.linalg.solve(normal, right), np.float64)
            residual = offsets - change @ unknowns.rows
        # d(r (1 - u)^2) / dr with u = (r / bound)^2 is (1 - u) (1 - 5 u).
        slope = inside * (5.0 * inside - 4.0) * sure
        agrees = found & (_inside(np.abs(residual) * clear, kinds) ** 2 > LIMITS.edges.counted)
        return cls(unknowns, samples, edges, change, weights, normal, expected, residual, agrees, slope)

    @property
    def variance(self) -> float:
        """Of a located edge [px^2]: sigma^2 = sum(w r^2) / (sum(w) - 6)."""
        return float(self.weights @ self.residual**2) / max(float(self.weights.sum()) - 6.0, 1.0)

    @property
    def spread(self) -> float:
        """Deviation of a located edge [px]."""
        return sqrt(self.variance)

    @property
    def length2(self) -> float:
        """Squared length of the pose's part of the step, in deviations that the edges leave."""
        return length2(self.change[POSE], self.variance * inverted(self.normal)[POSE, POSE])

    @property
    def moved_px(self) -> float:
        """How far the step moves edges [px], by the mean square: one along a side of the tag shifts half of them."""
        carried = self.unknowns.carried
        shifts = self.change[:carried] @ self.unknowns.rows[:carried]
        return sqrt(float(shifts @ shifts) / len(shifts))

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
        root = np.sqrt(self.weights)
        steep = self.unknowns.rows * root
        count = len(steep)
        place = (square + (square.max() + 1) * np.arange(count)[:, None]).ravel()
        pulls = steep * (root * self.residual)
        alone = float((pulls * (inverse @ pulls)).sum())
        term = together = np.bincount(place, pulls.ravel()).reshape(count, -1)
        for ratio in GIVES_WAY:
            back = ratio * (steep * (inverse @ term)[:, square]).sum(axis=0)
            term = np.bincount(place, (steep * back).ravel()).reshape(count, -1)
            together = together + term
        return float((together * (inverse @ together)).sum()) / max(alone, LEAST_RIDGE)

    def pose(self, at: State, prior: Prior, square: Numbers) -> Pose:
        """The pose after this step.

        Args:
            at: where it led.
            prior: what was known beforehand.
            square: of the print each sample of the model is in `(m,)`.
        """
        limits = LIMITS.edges
        # C = (v b + s^2) (J^T W J)^-1: b is what neighbours share by their residuals (blur makes v larger, not b); s is
        # what interpolation leaves and no number of samples averages out.
        shared = max(self.shared(square[self.samples.index], inverted(self.normal)), 1.0)
        noise = shared * self.influence_variance + limits.systematic_px**2
        # What is known of the bend is no better for edges that are worse than they look; of the motion it is, as a
        # vibration that no attitude knows makes both worse.
        normal = self.normal.copy()
        if "rise" in self.unknowns:
            rise = self.unknowns["rise"]
            normal[rise, rise] += (noise - self.expected) * self.unknowns.information[rise, rise]
        covariance = noise * inverted(normal)
        of_pose, bend = prior.measured(at, self.unknowns, covariance)
        size = np.abs(self.residual)
        return Pose(
            at.rotation,
            at.position,
            of_pose,
            "edges",
            int(self.agrees.sum()),
            self.spread,
            float(self.edges.room[self.agrees].sum() / self.edges.room.sum()),
            float(np.linalg.norm(self.change[:3])) / max(float(np.linalg.norm(at.position)), 1e-9),
            loss=self._loss(size),
            blur_px=self.edges.width,
            widest_px=self.edges.widest,
            ragged_px=MAD * max(median(size[kind]) for kind in kinds_of(self.edges.found, self.samples.upright)),
            shift_px=float(self.change[-1]),
            blown=self.edges.blown,
            motion=at.motion,
            known_motion=prior.start.known_motion,
            seen_motion=prior.seen_motion(at, self.unknowns, covariance),
            bend=bend,
            known_bend=prior.bend,
            stretch=None if at.stretch is None else float(at.stretch[0]),
        )

    def _loss(self, size: Array) -> float:
        """Loss for rivals: geometric mean of min(r, missed)^2 + least^2.

        Log odds of two fits are then n / 2 times the log of their ratio, and a hidden sample costs both the same.
        """
        missed = 2.0 * LIMITS.edges.located_px
        squared = np.where(self.agrees, np.minimum(size, missed), missed) ** 2 + LIMITS.edges.least_scale_px**2
        return float(np.exp(np.mean(np.log(squared))))


def _inside(size: Array, kinds: Sequence[Numbers]) -> Array:
    """Root of Tukey's weights by the sizes of all residuals `(n,)` [px]: the larger median of both kinds is usual."""
    usual = max(MAD * max(median(size[kind]) for kind in kinds), LIMITS.edges.least_scale_px)
    return np.asarray(np.maximum(1.0 - (size / (LIMITS.edges.tukey * usual)) ** 2, 0.0), np.float64)
