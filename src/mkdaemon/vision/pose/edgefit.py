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

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import APART2, HALF, LIMITS
from mkdaemon.vision.pose.bend import BENT, RISES, BentPrint
from mkdaemon.vision.pose.edgefind import FoundEdges, Samples, find_edges, without_glare
from mkdaemon.vision.pose.edgelight import UnevenLight
from mkdaemon.vision.pose.edgemodel import EdgeModel, rows_of, seen_across, spread_evenly
from mkdaemon.vision.pose.edgestep import EdgeStep
from mkdaemon.vision.pose.linetime import MOTIONS, SeenMotion
from mkdaemon.vision.pose.nuisance import (
    Prior,
    motion_known,
    with_bend,
    with_blown,
    with_motion,
    with_shift,
    with_stretch,
)
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.pose.prints import sheet_of
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.pose.rolling import at_rest, before_motion, cross, exposed, motion_at_rest, motion_jacobian, skew
from mkdaemon.vision.tags.tagmap import Target

LEAST_EDGES = 12
"""Fewer fix no pose: twice its unknowns."""
CUT = 1.05
"""Width of edges over their reach from which a fit has not settled: the next reach is longer."""
FIRST_BEND_PX = 30.0
"""Deviation of an edge while its reach is long, for the bend [px]: edges that are not yet found would bend a print."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """What is known about the direction of a target's normal.

    Attributes:
        up: vertical `(3,)` [camera].
        spread: standard deviation, each axis [rad].
    """

    up: Array
    spread: float

    def pull(self, rotation: Array, located_px: float) -> tuple[Array, Array]:
        """Normal matrix `(6, 6)` and right side `(6,)`, in units of a located edge's variance.

        With n the target's normal and e = n x up the turn that would level it, the cost is |(I - n n^T) w - e|^2 over
        spread^2: the turn about n itself is free.
        """
        normal = rotation[:, 2]
        error = skew(normal) @ self.up
        across = np.eye(3) - np.outer(normal, normal)
        weight = (located_px / self.spread) ** 2
        matrix, right = np.zeros((6, 6)), np.zeros(6)
        matrix[3:, 3:] = weight * across
        right[3:] = weight * error
        return matrix, right


@dataclass(frozen=True, slots=True, eq=False)
class LocatedEdges:
    """Edges of one image around a pose.

    Attributes:
        index: which samples of the model are in view `(n,)`.
        offsets: of the edges from where the pose puts them `(n,)` [px], towards the bright side.
        found: whether an edge of the right sense was found `(n,)`.
        trust: what lies beside them and neighbours leave of each, over the variance of the offset `(n,)`.
        jacobian: of the offsets by pose `(n, 6)`.
        by_rise: and by the rise of the print `(n, 3)`; empty where it does not bend.
        pixels: where the pose puts them `(n, 2)` [px].
        normals: towards the brighter side, unit `(n, 2)`.
    """

    index: npt.NDArray[np.intp]
    offsets: Array
    found: npt.NDArray[np.bool_]
    trust: Array
    jacobian: Array
    by_rise: Array
    pixels: Array
    normals: Array


def _moved(step: EdgeStep, carried: int) -> float:
    """How far a step moves the edges [px], by the mean square: a move along one side of the tag shifts half of them."""
    shifts = step.samples.jacobian[:, :carried] @ step.change[:carried]
    return sqrt(float(shifts @ shifts) / len(shifts))


@dataclass(slots=True, eq=False)
class _State:
    """Where a fit is.

    Attributes:
        rotation: camera from target `(3, 3)`.
        position: of the target `(3,)` [m; RDF].
        motion: under a rolling shutter `(4,)`; none under a global one.
        bent: the bend of the print; none where it is taken for flat.
        projection: of the lens, stretched.
        stretch: of the ratio of its focal lengths.
    """

    rotation: Array
    position: Array
    motion: Array | None
    bent: BentPrint | None
    projection: Projection
    stretch: float = 0.0

    def move(self, step: Array, carried: int) -> None:
        """Make a step; behind the first `carried` unknowns comes the motion."""
        self.rotation = turn(self.rotation, step[3:6])
        self.position = self.position + step[:3]
        if self.bent is not None:
            self.bent = self.bent.moved(step[BENT])
        if self.motion is not None:
            self.motion = self.motion + step[carried - MOTIONS : carried]

    def ran_away(self, start: Pose) -> bool:
        """Whether it left what a camera sees, or the neighbourhood of where it began."""
        if not np.isfinite(self.position).all() or self.position[2] < NEAR_M:
            return True
        away = float(np.linalg.norm(self.position - start.position))
        return away > LIMITS.edges.max_move * start.range_m


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """What one step is solved from.

    Attributes:
        samples: of the model.
        edges: found there.
        state: where the fit is.
        start: where it began.
        level: where the normal should point, if anywhere.
        edge_px: deviation of a located edge [px].
        stretch_sd: deviation of the ratio of the focal lengths; zero takes them as exact.
        is_near: the place is nearly known.
    """

    samples: Samples
    edges: FoundEdges
    state: _State
    start: Pose
    level: Level | None
    edge_px: float
    stretch_sd: float
    is_near: bool

    @property
    def bend_px(self) -> float:
        """Deviation of a located edge that the bend is weighed with [px]."""
        return self.edge_px if self.is_near else FIRST_BEND_PX


class EdgeFit:
    """Fits the pose of one target."""

    def __init__(self, target: Target, projection: Projection, max_samples: int | None = None) -> None:
        model = self.model = EdgeModel.of(target)
        self._points = model.stepped
        self._sheet = sheet_of(target)
        self._bends = np.zeros((0, 0)) if self._sheet is None else self._sheet.terms(self._points)
        self._projection = projection
        self._shutter = projection.shutter
        self._max_samples = LIMITS.edges.max_samples if max_samples is None else max_samples

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

        Returns:
            The pose, or none when too few edges were seen or the fit ran away.
        """
        limits = LIMITS.edges
        last: EdgeStep | None = None
        edge_px = weighed_px = limits.located_px
        moved, to_go, carried = np.inf, np.zeros(6), 6
        light: UnevenLight | None = None
        state = self._start(start, rolls=self._shutter.rolls and stretch_sd == 0.0, bends=stretch_sd == 0.0)
        is_blown = int(pixels.max()) >= LIMITS.read.saturated
        for k in range(iterations):
            is_near = k >= len(limits.reach_px) - 2
            reach = self._reach(k, last)
            found = self._find(pixels, state, reach, light, is_blown=is_blown, is_near=is_near)
            if found is None:
                return None
            samples, edges, light = found
            edge_px = edge_px if last is None else max(last.variance**0.5, limits.least_scale_px)
            system = _System(samples, edges, state, start, level, edge_px, stretch_sd, is_near)
            now, carried = self._solve(system)
            step = now.change
            before, moved = moved, _moved(now, carried)
            # Edges wider than they were looked for are cut off, and less far from their place than they are.
            is_cut = edges.widest > CUT * reach
            to_go = step[:6]
            is_longer = last is not None and k > len(limits.reach_px) - 1 and moved > before and not is_cut
            if is_longer and now.length2 < APART2:
                # Edges of jagged pixels answer more than a move asks: the step before was nearer.
                break
            last, weighed_px = now, system.bend_px
            state.move(step, carried)
            if state.ran_away(start):
                return None
            if moved < limits.settled_px and is_near and not is_cut:
                to_go = np.zeros(6)
                break
            if stretch_sd > 0.0:
                state.stretch += float(step[carried - 1])
                state.projection = self._projection.stretch(state.stretch)
        if last is None:
            return None
        fitted = last.pose(state.rotation, state.position, self.model.square, state.bent, weighed_px)
        # It has not arrived: how far it would go on is an error, too.
        fitted = replace(fitted, covariance=fitted.covariance + np.outer(to_go, to_go))
        if state.motion is None:
            return replace(fitted, stretch=state.stretch if stretch_sd > 0.0 else None)
        seen = self._seen_motion(last, state, start, slice(carried - MOTIONS, carried), edge_px)
        return replace(fitted, motion=state.motion, known_motion=start.known_motion, seen_motion=seen)

    def _seen_motion(self, last: EdgeStep, at: _State, start: Pose, block: slice, edge_px: float) -> SeenMotion | None:
        """What the image alone says about the motion, where that tells a line time."""
        if at.motion is None or self._shutter.is_given:
            return None
        asked = motion_known(start, self._shutter)
        return last.seen_motion(self.model.square, block, at.motion, asked, edge_px)

    def _reach(self, k: int, last: EdgeStep | None) -> float:
        """How far from their place edges are looked for in a step [px]; within less a wide edge has no middle."""
        reach_px = LIMITS.edges.reach_px
        return max(reach_px[min(k, len(reach_px) - 1)], last.edges.widest if last is not None else 0.0)

    def _start(self, start: Pose, *, rolls: bool, bends: bool) -> _State:
        """Where a fit begins. Stills that doubt the lens show no motion of the camera, and take the print for flat."""
        motion = (start.motion if start.motion is not None else motion_at_rest()) if rolls else None
        bent = self._bent_at(start) if bends else None
        return _State(start.rotation, start.position, motion, bent, self._projection)

    def _find(
        self, pixels: Grey, state: _State, reach: float, light: UnevenLight | None, *, is_blown: bool, is_near: bool
    ) -> tuple[Samples, FoundEdges, UnevenLight | None] | None:
        """Find edges, without what uneven light moves them; none when they are too few, or too few are in view."""
        samples = self._project(
            pixels.shape, state.rotation, state.position, reach, state.projection, state.motion, state.bent
        )
        if samples is None:
            return None
        if is_blown:
            samples = without_glare(pixels, samples)
        edges = find_edges(pixels, samples, is_blown=is_blown, is_near=is_near)
        if int(edges.found.sum()) < LEAST_EDGES:
            return None
        if edges.sides is not None and edges.blown is None:
            light = light or UnevenLight.of(edges.sides, edges.found)
            if light is not None and not light.is_even(edges.width):
                moved = light.moved(edges.sides, edges.widths)
                unsure = light.unsure(moved, edges.sides)
                edges = replace(edges, offsets=edges.offsets - moved, unsure=unsure)
        return samples, edges, light

    def _solve(self, system: _System) -> tuple[EdgeStep, int]:
        """Solve for the step, with how many unknowns move the edges themselves: pose, bend and lens."""
        limits, state, samples, edges = LIMITS.edges, system.state, system.samples, system.edges
        weighed = system.edge_px if system.is_near else limits.located_px
        level = system.level
        prior: Prior = (np.zeros((6, 6)), np.zeros(6)) if level is None else level.pull(state.rotation, weighed)
        if state.bent is not None:
            prior = with_bend(prior, state.bent, system.bend_px)
        if system.stretch_sd > 0.0:
            lens = limits.located_px / system.stretch_sd
            samples, prior = with_stretch(samples, prior, state.projection, state.stretch, lens)
        carried = samples.jacobian.shape[1]
        if state.motion is not None:
            samples, prior = with_motion(
                samples, prior, system.start, state.motion, state.position, system.edge_px, self._shutter
            )
        if edges.blown is not None:
            samples, prior = with_blown(samples, prior, edges.blown, system.edge_px)
        smaller = self.model.smaller[samples.index] if system.is_near else None
        samples, prior = with_shift(samples, prior, edges.toned, smaller, weighed)
        return EdgeStep.solve(samples, edges, prior, is_near=system.is_near), carried

    def locate(self, pixels: Grey, pose: Pose) -> LocatedEdges | None:
        """Find the edges around a fitted pose; none when too few are in view."""
        reach = LIMITS.edges.reach_px[-1]
        samples = self._project(
            pixels.shape, pose.rotation, pose.position, reach, self._projection, pose.motion, self._bent_at(pose)
        )
        if samples is None:
            return None
        edges = find_edges(pixels, samples, is_blown=int(pixels.max()) >= LIMITS.read.saturated)
        jacobian, by_rise = samples.jacobian[:, :6], samples.jacobian[:, BENT if self._sheet is not None else slice(0)]
        offsets = edges.offsets - pose.shift_px * edges.toned
        seen = edges.found, edges.trust * edges.room
        return LocatedEdges(samples.index, offsets, *seen, jacobian, by_rise, samples.pixels, samples.normals)

    def _bent_at(self, start: Pose) -> BentPrint | None:
        """The bend where a fit begins; none where the target has no sheet that bends."""
        if self._sheet is None:
            return None
        known = start.known_bend or self._sheet.prior
        rise = known.mean if start.bend is None else start.bend.mean
        return BentPrint.begin(self._sheet, known, rise, self._points, self._bends)

    def _project(
        self,
        shape: tuple[int, ...],
        rotation: Array,
        position: Array,
        reach: float,
        projection: Projection,
        motion: Array | None,
        bent: BentPrint | None,
    ) -> Samples | None:
        """Samples in view with u = project(R p + t) and J = n . du/dx; none when they are too few."""
        limits, count = LIMITS, len(self.model.points)
        still = seen = (rotation @ (self._points if bent is None else bent.points).T + position[:, None]).T
        times = np.zeros(len(still))
        if motion is not None:
            seen, times = exposed(still, motion, projection)
        pixels, are_visible = projection.project(seen)
        uv, visible = pixels[:count], are_visible.reshape(3, count).all(axis=0)
        normals, cell_px = seen_across(pixels)
        edge = np.minimum(reach, HALF * cell_px) + 1.0
        height, width = shape
        visible &= cell_px > limits.cells.readable_px
        visible &= (
            (uv[:, 0] > edge) & (uv[:, 1] > edge) & (uv[:, 0] < width - 1 - edge) & (uv[:, 1] < height - 1 - edge)
        )
        # Facing away: the sight line and the normal of the paper disagree only for targets of several planes.
        index = np.flatnonzero(visible)
        if len(index) < LEAST_EDGES:
            return None
        if len(index) > self._max_samples:
            index = index[spread_evenly(len(index), self._max_samples)]
        normals, rest = rows_of(normals, index), rows_of(still, index)
        moved = rest if motion is None else seen[index]
        point, along = projection.jacobian(moved), normals
        if motion is not None:
            along = at_rest(normals, point, moved, motion, projection.line_time)
        by_point = by_rest = along[:, :1] * point[:, 0] + along[:, 1:] * point[:, 1]
        columns = []
        if motion is not None:
            by_rest = before_motion(by_point, motion, times[index])
            columns = [motion_jacobian(by_point, rest, times[index])]
        if bent is not None:
            by_height = by_rest @ (rotation @ bent.sheet.normal)
            columns = [by_height[:, None] * rows_of(bent.terms[:, :RISES], index), *columns]
        # A turn w moves a point at `arm` by w x arm, so that n . du = w . (arm x n du/dP).
        jacobian = np.column_stack([by_rest, cross(rest - position, by_rest), *columns])
        near = np.minimum(reach, HALF * cell_px[index])
        upright = self.model.upright[index]
        return Samples(index, rows_of(uv, index), normals, near, jacobian, times[index], cell_px[index], upright)
