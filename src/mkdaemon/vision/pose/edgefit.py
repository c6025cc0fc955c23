"""Pose refinement on the black-white edges of a known target.

Every edge between cells is sampled; each sample is located along its normal to a fraction of a pixel, and a robust
Gauss-Newton step moves the pose. Hidden or cut parts only take samples away. Best from four pixels a cell upwards.

With d_i the offset of edge i along its normal n_i [px] and J_i = n_i . du/dx the derivative of its pixel u by the pose
x = (position, rotation vector), a step solves min over x of sum w_i (d_i - J_i x - s)^2. The shift s is common to all
edges: a tone curve lifts the middle of a blurred edge and so spreads white over black; sharpening and ink move it too.
Without s a tag would be taken for a nearer or farther one; edges of both senses tell s from its size.

Source: model-edge tracking, Drummond and Cipolla, PAMI 24(7), 2002; Tukey weights, Holland and Welsch 1977.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from mkdaemon.vision.arrays import Array, Bools, Grey, Numbers
from mkdaemon.vision.limits import APART2, HALF, LIMITS
from mkdaemon.vision.pose.ambiguity import loss_of
from mkdaemon.vision.pose.edgefind import LEAST_OF_A_KIND, FoundEdges, find_edges, kinds_of
from mkdaemon.vision.pose.edgemodel import EdgeModel, Samples, seen_across
from mkdaemon.vision.pose.pose import LEAST_RIDGE, Pose, damped, inverted, length2, median
from mkdaemon.vision.pose.prints import RISES, sheet_of
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import POSE, SETTLED, Prior, State, TargetLevel, UnknownRow, Unknowns, not_arrived
from mkdaemon.vision.tags.cellread import sample
from mkdaemon.vision.tags.tagmap import Target

LEAST_EDGES = 12
"""Fewer fix no pose: twice its unknowns."""
CUT = 1.05
"""Width of edges over their reach from which a fit has not settled: the next reach is longer."""
MAD = 1.4826
"""Deviation of Gaussian residuals over their median absolute value."""
LEAST_SLOPE = 0.3
"""Least slope of the influence function over the mean weight: below, the variance of a robust estimate is undefined
(0.83 for Gaussian residuals)."""
ROOMY = 0.5
"""Room of edges that tell how large residuals are."""
GIVES_WAY = (1.0 / 2.0, 3.0 / 4.0, 5.0 / 6.0)
"""Each term of the series of (1 - h)^-1/2 over h times the one before."""
ROUNDS = 3
"""Weights and step depend on each other: number of iterations."""
CLEAR_PERCENT = 75
"""Percentile of the contrast that the clear edges have."""


class EdgeStep:
    """One step over `k` unknowns by rounds of weighted least squares.

    See `unknowns`, with Tukey's w = t (1 - (r / c sigma)^2)^2 inside c sigma, zero outside; t is the trust in an edge
    times its room, r holds its root; sigma from the median of |r|. Far from its place sigma is the larger one of the
    two ways that edges run, or half of the edges, which are in their place, would outvote the others.

    Args:
        unknowns: of the offsets, the common shift last.
        samples: of the edge model.
        edges: where the image has them.
        expected: variance of a located edge [px^2].
        are_placed: whether most edges of both ways are in their place.

    Attributes:
        unknowns, edges: see above.
        change: of the unknowns `(k,)`.
        weights: of the samples `(n,)`, zero without an edge.
        variance: of a located edge [px^2]: sigma^2 = sum(w r^2) / (sum(w) - 6).
        agrees: whether each lies where the pose puts it, by the larger median of both ways and without trust `(n,)`.
    """

    def __init__(
        self, unknowns: Unknowns, samples: Samples, edges: FoundEdges, expected: float, *, are_placed: bool = True
    ) -> None:
        self.unknowns, self.edges = unknowns, edges
        self._samples, self._expected = samples, expected
        sure = edges.trust * edges.room
        # Doubt of edges without room makes their residuals small: they would make those outliers that have it.
        roomy = edges.found & (edges.room > ROOMY)
        telling = roomy if np.count_nonzero(roomy) >= LEAST_OF_A_KIND else edges.found
        kinds = kinds_of(telling, samples.upright)
        usual = [telling.nonzero()[0]] if are_placed else kinds
        # Iteratively reweighted least squares with Tukey's w = (1 - (r / bound)^2)^2, zero beyond the bound.
        # Source: A. Beaton, J. Tukey, Technometrics 16 (1974), 147.
        residual = edges.offsets
        for _ in range(ROUNDS):
            inside = _inside(np.abs(residual) * np.sqrt(sure), usual) * edges.found
            self.weights = inside**2 * sure
            self._normal, right = unknowns.equations(self.weights, edges.offsets, expected)
            self.change = np.asarray(np.linalg.solve(self._normal, right), np.float64)
            residual = edges.offsets - self.change @ unknowns.rows
        self._residual = residual
        self._freedom = max(float(self.weights.sum()) - 6.0, 1.0)
        self.variance = float(self.weights @ residual**2) / self._freedom
        # Influence w r: its slope d(r (1 - u)^2) / dr with u = (r / bound)^2 is (1 - u) (1 - 5 u).
        self._slope = float((inside * (5.0 * inside - 4.0) * sure).sum())
        self.agrees = edges.found & (_inside(np.abs(residual) * np.sqrt(edges.room), kinds) ** 2 > LIMITS.edges.counted)

    @property
    def length2(self) -> float:
        """Squared length of the pose's part of the step, in deviations that the edges leave."""
        return length2(self.change[POSE], self.variance * inverted(self._normal)[POSE, POSE])

    @property
    def moved_px(self) -> float:
        """Movement of the edges by the step [px], by the mean square; a shift along a side moves half of them."""
        carried = self.unknowns.carried
        shifts = self.change[:carried] @ self.unknowns.rows[:carried]
        return sqrt(float(shifts @ shifts) / len(shifts))

    def _influence_variance(self) -> float:
        """Variance of an edge as the robust estimate feels it [px^2].

        An M-estimate with influence psi(r) = w r has the covariance sum(psi^2) / sum(psi')^2 over J^T J. With the
        normal matrix J^T W J in its place: v = (sum(psi^2) / sum(w)) (sum(w) / sum(psi'))^2. Source: Huber, Robust
        Statistics, 6.3. Where residuals crowd near the bound, psi' is small and v large.
        """
        total = float(self.weights.sum())
        felt = float(((self.weights * self._residual) ** 2).sum()) / self._freedom
        return felt * (total / max(self._slope, LEAST_SLOPE * total)) ** 2

    def _shared(self, square: Numbers) -> float:
        """By how much errors that the samples of a square `(n,)` have in common raise the variance, by their residuals.

        With g_i = J_i w_i r_i, A the inverse normal matrix and G the sum of g over a square:
        sum(G^T A G) / sum(g^T A g), 1 for errors that have nothing in common.

        A fit gives way to what its samples have in common, the more the fewer there are: the residuals of a square are
        (I - H)^-1/2 r, H = (w^1/2 J) A (w^1/2 J)^T among them. Source: covariance by clusters, Bell and McCaffrey,
        Survey Methodology 28(2), 2002; the root by the first terms of its series.
        """
        inverse, root = inverted(self._normal), np.sqrt(self.weights)
        steep = self.unknowns.rows * root
        count = len(steep)
        place = (square + (square.max() + 1) * np.arange(count)[:, None]).ravel()
        pulls = steep * (root * self._residual)
        alone = float((pulls * (inverse @ pulls)).sum())
        term = together = np.bincount(place, pulls.ravel()).reshape(count, -1)
        for ratio in GIVES_WAY:
            back = ratio * (steep * (inverse @ term)[:, square]).sum(axis=0)
            term = np.bincount(place, (steep * back).ravel()).reshape(count, -1)
            together = together + term
        return max(float((together * (inverse @ together)).sum()) / max(alone, LEAST_RIDGE), 1.0)

    def pose(self, at: State, prior: Prior, square: Numbers) -> Pose:
        """The pose after this step.

        Args:
            at: where it led.
            prior: what was known beforehand.
            square: of the print each sample of the model is in `(m,)`.
        """
        # C = (v b + s^2) (J^T W J)^-1: b is what neighbours share, s what interpolation leaves and no number of samples
        # averages out.
        shared = self._shared(square[self._samples.index])
        noise = shared * self._influence_variance() + LIMITS.edges.systematic_px**2
        # What is known of the bend is no better for edges that are worse than they look; of the motion it is, as a
        # vibration that no attitude knows makes both worse.
        normal = self._normal.copy()
        if "rise" in self.unknowns:
            rise = self.unknowns["rise"]
            normal[rise, rise] += (noise - self._expected) * self.unknowns.information[rise, rise]
        covariance = self.unknowns.covariance(inverted(normal), self.weights, noise)
        of_pose, bend = prior.measured(at, self.unknowns, covariance)
        limits, edges, size = LIMITS.edges, self.edges, np.abs(self._residual)
        # Melted edges leave a residual, at least in one of the two ways that they run.
        ragged_px = MAD * max(median(size[kind]) for kind in kinds_of(edges.found, self._samples.upright))
        return Pose(
            at.rotation,
            at.position,
            of_pose,
            "edges",
            int(self.agrees.sum()),
            sqrt(self.variance),
            float(edges.room[self.agrees].sum() / edges.room.sum()),
            float(np.linalg.norm(self.change[:3])) / max(float(np.linalg.norm(at.position)), 1e-9),
            loss=loss_of(np.where(self.agrees, size, np.inf), 2.0 * limits.located_px, limits.least_scale_px),
            blur_px=edges.width,
            melted_px=LIMITS.cells.melted_widths * edges.widest if ragged_px >= LIMITS.health.drift_px else 0.0,
            shift_px=float(self.change[-1]),
            blown=edges.blown,
            motion=at.motion,
            known_motion=prior.start.known_motion,
            seen_motion=prior.seen_motion(at, self.unknowns, covariance),
            bend=bend,
            known_bend=prior.bend,
        )


def _inside(size: Array, kinds: Sequence[Numbers]) -> Array:
    """Root of Tukey's weights by the sizes of all residuals `(n,)` [px]: the larger median of both kinds is usual."""
    usual = max(MAD * max(median(size[kind]) for kind in kinds), LIMITS.edges.least_scale_px)
    return np.asarray(np.maximum(1.0 - (size / (LIMITS.edges.tukey * usual)) ** 2, 0.0), np.float64)


@dataclass(frozen=True, slots=True)
class EdgeEvidence:
    """Evidence of the edges about a fitted pose.

    Two questions tell a right pose from one that follows the rim of something lying on the print: do the edges agree
    whose cells are seen, and does the pose stay where it is when any one straight line of edges is taken away? A rim is
    straight and covers one line of the grid.

    Attributes:
        seen: share of the edges in view with the print's contrast.
        agreeing: share of these that lie where the pose puts them.
        leverage: largest turn of the pose when one straight line of edges is taken away [rad].
    """

    seen: float = 0.0
    agreeing: float = 0.0
    leverage: float = 0.0

    @property
    def supports(self) -> bool:
        """Whether the pose can be believed with parts of the target hidden."""
        agrees = self.seen >= HALF and self.agreeing >= LIMITS.agreement.whole
        return agrees and self.leverage <= LIMITS.edges.max_leverage

    @property
    def explains(self) -> bool:
        """Whether the edges that are seen lie where the pose puts them, however many are hidden."""
        return self.agreeing >= LIMITS.likeness.clear


class EdgeFit:
    """Fits the pose of one target."""

    def __init__(self, target: Target, projection: Projection) -> None:
        model = self.model = EdgeModel.of(target)
        self._points = model.stepped
        self._sheet = sheet_of(target)
        self._terms = None if self._sheet is None else self._sheet.terms(self._points)
        self._projection = projection

    def fit(self, pixels: Grey, start: Pose, iterations: int = 12, level: TargetLevel | None = None) -> Pose | None:
        """Refine a pose.

        Args:
            pixels: `(h, w)` uint8.
            start: within about half a cell of the truth.
            iterations: Gauss-Newton steps at most.
            level: where the target's normal should point.

        Returns:
            The pose, or none when too few edges were seen or the fit ran away.
        """
        limits = LIMITS.edges
        last: EdgeStep | None = None
        moved, to_go, are_near = np.inf, np.zeros(6), False
        prior = Prior(start, level, self._projection, self._sheet)
        state = prior.begin()
        for k in range(iterations):
            reach = limits.reach_px[min(k, len(limits.reach_px) - 1)]
            was_near, are_near, edge_px = are_near, k > 1, limits.located_px
            if last is not None:
                # Within less than its width an edge has no middle.
                reach = max(reach, last.edges.widest)
                edge_px = max(sqrt(last.variance), limits.least_scale_px)
                # Where edges lie in line so well they are nearly in their place.
                are_near |= edge_px < HALF * limits.located_px
            found = self._find(pixels, state, prior, reach, are_near=are_near)
            if found is None:
                return None
            samples, edges, unknowns = found
            step = EdgeStep(unknowns, samples, edges, edge_px**2, are_placed=k > 1)
            before, moved = moved, step.moved_px
            # Edges wider than they were looked for are cut off, and less far from their place than they are.
            is_cut = edges.widest > CUT * reach
            to_go = step.change[POSE]
            is_longer = k > len(limits.reach_px) - 1 and moved > before and not is_cut
            if is_longer and step.length2 < APART2:
                # Edges of jagged pixels answer more than a move asks: the step before was nearer.
                break
            last, state = step, state.moved(step.unknowns, step.change)
            if state.ran_away(start):
                return None
            # A first step near by is to the next one as the one before is to it: that one has to be short.
            is_last = was_near or moved**2 * step.length2 <= SETTLED * before**2
            if moved < limits.settled_px and are_near and is_last and not is_cut:
                to_go = np.zeros(6)
                break
        return None if last is None else not_arrived(last.pose(state, prior, self.model.square), to_go)

    def locate(self, pixels: Grey, pose: Pose) -> tuple[Samples, FoundEdges, Unknowns] | None:
        """Samples around a fitted pose, their edges without the common shift, and the unknowns of a step by these.

        None when too few are in view or found.
        """
        prior = Prior(pose, None, self._projection, self._sheet)
        found = self._find(pixels, prior.begin(), prior, LIMITS.edges.reach_px[-1])
        if found is None:
            return None
        samples, edges, unknowns = found
        return samples, replace(edges, offsets=edges.offsets - pose.shift_px * edges.toned), unknowns

    def evidence(self, pixels: Grey, pose: Pose) -> EdgeEvidence:
        """Ask all edges of an image `(h, w)` about a pose fitted to some; too few in view say nothing."""
        located = self.locate(pixels, pose)
        if located is None:
            return EdgeEvidence()
        samples, edges, unknowns = located
        sides = self.model.sides[:, samples.index] @ pose.rotation.T + pose.position
        dark, bright = (sample(pixels, self._projection.project(points, pose.motion)[0]) for points in sides)
        contrast = bright - dark
        seen = contrast > HALF * max(float(np.percentile(contrast, CLEAR_PERCENT)), 1.0)
        size = np.abs(edges.offsets)
        scatter = max(MAD * median(size[edges.found]), LIMITS.health.drift_px)
        agrees = edges.found & (size < LIMITS.certainty.deviations * scatter)
        line = self.model.line[samples.index]
        leverage = _leverage(unknowns.rows[POSE].T[agrees], edges.offsets[agrees], line[agrees])
        return EdgeEvidence(float(seen.mean()), float((agrees & seen).sum()) / max(int(seen.sum()), 1), leverage)

    def _find(
        self, pixels: Grey, at: State, prior: Prior, reach: float, *, are_near: bool = True
    ) -> tuple[Samples, FoundEdges, Unknowns] | None:
        """Samples in view, their edges, and the unknowns of a step; none when too few are in view or found."""
        limits, count, points = LIMITS, len(self.model.points), self._points
        if self._sheet is not None and self._terms is not None and at.rise is not None and at.rise.any():
            points = self._sheet.bent(points, self._terms, at.rise)
        still = (at.rotation @ points.T + at.position[:, None]).T
        seen, times = self._projection.exposed(still, at.motion)
        pixels_at, are_visible = self._projection.project(seen)
        uv, visible = pixels_at[:count], are_visible.reshape(3, count).all(axis=0)
        normals, cell_px = seen_across(pixels_at)
        reaches = np.minimum(reach, HALF * cell_px)
        visible &= cell_px > limits.cells.readable_px
        visible &= (np.minimum(uv, np.array(pixels.shape[::-1]) - 1 - uv) > reaches[:, None] + 1.0).all(axis=1)
        index = visible.nonzero()[0]
        if len(index) < LEAST_EDGES:
            return None
        # The first step leaves another one to go: half of them tell it.
        most = limits.edges.max_samples if are_near else limits.edges.max_samples // 2
        if len(index) > most:
            index = index[np.arange(most) * len(index) // most]
        # Columns that lie together in memory are added and multiplied faster than rows of three.
        uv, normals, seen, still = (columns.T[:, index].T for columns in (uv, normals, seen, still))
        samples = Samples(index, uv, normals, reaches[index], cell_px[index], self.model.upright[index], are_near)
        edges = find_edges(pixels, samples)
        if np.count_nonzero(edges.found) < LEAST_EDGES:
            return None
        point = self._projection.jacobian(seen)
        by_point = normals[:, :1] * point[:, 0] + normals[:, 1:] * point[:, 1]
        # The bend comes last: edges that are not yet found would bend a print.
        heights = self._terms[:RISES, index] if are_near and self._terms is not None else None
        table = prior.table(at, by_point, still - at.position, times[index], heights)
        if edges.light is not None:
            table.append(edges.light)
        table.append(shifts(edges.toned, self.model.smaller[:, index]))
        return samples, edges, Unknowns(table)


def _leverage(jacobian: Array, offsets: Array, line: Numbers) -> float:
    """Largest turn [rad] that leaving out the samples of one line gives, to first order.

    Without the rows L of a line the least-squares pose moves by (J^T J - L^T L)^-1 L^T d_L.
    """
    normal, turns = damped(jacobian.T @ jacobian), [0.0]
    for k in np.unique(line):
        part = jacobian[line == k]
        step = np.linalg.solve(normal - part.T @ part, part.T @ offsets[line == k])
        turns.append(float(np.linalg.norm(step[3:])))
    return max(turns)


def shifts(toned: Array, smaller: Bools) -> UnknownRow:
    """A shift of all edges in proportion to their blur, the last unknown, and that of smaller tags.

    Blur does not let small cells get black or white: a tone curve or sharpening shifts their edges by less, or more.

    Args:
        toned: shift of each over that of all `(n,)`.
        smaller: which of them are on tags of each smaller size `(k, n)`.
    """
    count = smaller.sum(axis=1)
    rows = np.concatenate([smaller[(count > 0) & (count < len(toned))], np.ones((1, len(toned)))]) * toned
    return UnknownRow("shift", rows, np.full(len(rows), LIMITS.edges.shift_sd_px**-2))
