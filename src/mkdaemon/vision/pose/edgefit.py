"""Pose refinement on the black-white edges of a known target.

Every edge between cells (borders, bits, nested tags) is sampled; each sample is located along its normal to a fraction
of a pixel, and a robust Gauss-Newton step moves the pose. No closed quad is needed, so hidden or cut parts only take
samples away, and the normal matrix gives the covariance. Best from four pixels a cell upwards.

With d_i the offset of edge i along its normal n_i [px] and J_i = n_i . du/dx the derivative of its pixel u by the pose
x = (position, rotation vector), a step solves min over x of sum w_i (d_i - J_i x - s)^2. The shift s is common to all
edges: a tone curve lifts the middle of a blurred edge and so spreads white over black; sharpening and ink move it too.
Without s a tag would be taken for a nearer or farther one; edges of both senses tell s from its size.

Source: model-edge tracking, Drummond and Cipolla, PAMI 24(7), 2002; Tukey weights, Holland and Welsch 1977.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.limits import APART2, HALF, LIMITS
from mkdaemon.vision.pose.bend import RISES
from mkdaemon.vision.pose.edgefind import FoundEdges, find_edges
from mkdaemon.vision.pose.edgemodel import EdgeModel, Samples, rows_of, seen_across
from mkdaemon.vision.pose.edgestep import EdgeStep
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.prints import sheet_of
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import POSE, Level, Prior, State, Unknown, Unknowns, not_arrived
from mkdaemon.vision.tags.tagmap import Target

LEAST_EDGES = 12
"""Fewer fix no pose: twice its unknowns."""
CUT = 1.05
"""Width of edges over their reach from which a fit has not settled: the next reach is longer."""


class EdgeFit:
    """Fits the pose of one target."""

    def __init__(self, target: Target, projection: Projection) -> None:
        model = self.model = EdgeModel.of(target)
        self._points = model.stepped
        self._sheet = sheet_of(target)
        self._terms = None if self._sheet is None else self._sheet.terms(self._points)
        self._projection = projection
        self._shutter = projection.shutter

    def fit(
        self, pixels: Grey, start: Pose, iterations: int = 12, level: Level | None = None, stretch_sd: float = 0.0
    ) -> Pose | None:
        """Refine a pose.

        Args:
            pixels: `(h, w)` uint8.
            start: within about half a cell of the truth.
            iterations: Gauss-Newton steps at most.
            level: where the target's normal should point; what lies over the target is then an outlier.
            stretch_sd: deviation of the ratio of the focal lengths, which is unknown then; zero takes them as exact.
                Stills that doubt the lens show no motion of the camera, and take the print for flat.

        Returns:
            The pose, or none when too few edges were seen or the fit ran away.
        """
        limits = LIMITS.edges
        last: EdgeStep | None = None
        moved, to_go = np.inf, np.zeros(6)
        if stretch_sd > 0.0:
            prior = Prior(start, level, None, None, stretch_sd)
        else:
            prior = Prior(start, level, self._shutter, self._sheet)
        state = prior.begin()
        for k in range(iterations):
            is_near = k >= len(limits.reach_px) - 2
            # Within less than its width an edge has no middle.
            reach = max(limits.reach_px[min(k, len(limits.reach_px) - 1)], 0.0 if last is None else last.edges.widest)
            found = self._find(pixels, state, prior, reach, is_near=is_near)
            if found is None:
                return None
            samples, edges, table = found
            edge_px = limits.located_px if last is None else max(last.spread, limits.least_scale_px)
            if edges.light is not None:
                table.append(edges.light)
            table.append(shifts(edges.toned, self.model.smaller[samples.index]))
            step = EdgeStep.solve(Unknowns(table), samples, edges, edge_px**2, is_near=is_near)
            before, moved = moved, step.moved_px
            # Edges wider than they were looked for are cut off, and less far from their place than they are.
            is_cut = edges.widest > CUT * reach
            to_go = step.change[POSE]
            is_longer = last is not None and k > len(limits.reach_px) - 1 and moved > before and not is_cut
            if is_longer and step.length2 < APART2:
                # Edges of jagged pixels answer more than a move asks: the step before was nearer.
                break
            last, state = step, state.moved(step.unknowns, step.change)
            if state.ran_away(start):
                return None
            if moved < limits.settled_px and is_near and not is_cut:
                to_go = np.zeros(6)
                break
        return None if last is None else not_arrived(last.pose(state, prior, self.model.square), to_go)

    def locate(self, pixels: Grey, pose: Pose) -> tuple[Samples, FoundEdges, Unknowns] | None:
        """Find the edges around a fitted pose, without their common shift; none when too few are in view or found.

        Returns:
            The samples in view, their edges, and the unknowns that every fit has, by these samples.
        """
        prior = Prior(pose, None, self._shutter, self._sheet)
        found = self._find(pixels, prior.begin(), prior, LIMITS.edges.reach_px[-1])
        if found is None:
            return None
        samples, edges, table = found
        return samples, replace(edges, offsets=edges.offsets - pose.shift_px * edges.toned), Unknowns(table)

    def _find(
        self, pixels: Grey, at: State, prior: Prior, reach: float, *, is_near: bool = True
    ) -> tuple[Samples, FoundEdges, list[Unknown]] | None:
        """Samples in view, their edges, and the unknowns that every fit has; none when too few are in view or found.

        The samples are seen at u = project(R p + t), and move along their normals by n . du/dP.
        """
        limits, count = LIMITS, len(self.model.points)
        points = self._points
        if self._sheet is not None and self._terms is not None and at.rise is not None and at.rise.any():
            points = self._sheet.bent(points, self._terms, at.rise)
        projection = self._projection if at.stretch is None else self._projection.stretch(float(at.stretch[0]))
        still = (at.rotation @ points.T + at.position[:, None]).T
        seen, times = projection.exposed(still, at.motion)
        pixels_at, are_visible = projection.project(seen)
        uv, visible = pixels_at[:count], are_visible.reshape(3, count).all(axis=0)
        normals, cell_px = seen_across(pixels_at)
        edge = np.minimum(reach, HALF * cell_px) + 1.0
        height, width = pixels.shape
        visible &= cell_px > limits.cells.readable_px
        visible &= (
            (uv[:, 0] > edge) & (uv[:, 1] > edge) & (uv[:, 0] < width - 1 - edge) & (uv[:, 1] < height - 1 - edge)
        )
        # Facing away: the sight line and the normal of the paper disagree only for targets of several planes.
        index = np.flatnonzero(visible)
        if len(index) < LEAST_EDGES:
            return None
        most = limits.edges.max_samples
        if len(index) > most:
            index = index[np.arange(most) * len(index) // most]
        uv, normals, seen, still = (rows_of(columns, index) for columns in (uv, normals, seen, still))
        cell_px, upright = cell_px[index], self.model.upright[index]
        samples = Samples(index, uv, normals, np.minimum(reach, HALF * cell_px), cell_px, upright)
        point = projection.jacobian(seen)
        by_point = normals[:, :1] * point[:, 0] + normals[:, 1:] * point[:, 1]
        # The bend comes last: edges that are not yet found would bend a print.
        heights = self._terms[:RISES, index] if is_near and self._terms is not None else None
        table = prior.table(at, by_point, still - at.position, times[index], heights)
        if at.stretch is not None:
            by_stretch = (normals * projection.stretch_jacobian(uv)).sum(axis=1)
            table.append(Unknown("stretch", by_stretch[None], np.array([prior.stretch_sd**-2]), -at.stretch))
        edges = find_edges(pixels, samples, is_near=is_near)
        return (samples, edges, table) if np.count_nonzero(edges.found) >= LEAST_EDGES else None


def shifts(toned: Array, smaller: Bools) -> Unknown:
    """A shift of all edges in proportion to their blur, the last unknown, and that of smaller tags.

    Blur does not let small cells get black or white: a tone curve or sharpening shifts their edges by less, or more.
    Behind gamma 2.2 and a webcam one shift for both tags of a nested target left the range off by 0.8 and 1.4 mm at
    1.2 m, 0.2 and 0.3 mm with one each.

    Args:
        toned: shift of each over that of all `(n,)`.
        smaller: which of them are on tags of each smaller size `(n, k)`.
    """
    rows = np.vstack([smaller[:, smaller.any(axis=0) & ~smaller.all(axis=0)].T, np.ones_like(toned)]) * toned
    return Unknown("shift", rows, np.full(len(rows), LIMITS.edges.shift_sd_px**-2))
