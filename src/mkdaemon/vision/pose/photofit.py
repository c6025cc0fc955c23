"""Pose refinement on every pixel of a small tag.

Below four pixels a cell edges melt into each other and a located edge means little. Here the known print is rendered
through pose, pixel area and point spread, and pose x, light a and point spread B are fitted to the grey values at once:

    I(p) = a0 m(p; x, B) + a1 + a2 u + a3 v + m (1 - m) (a4 + a5 (1 - 2 m)) + a6 (l(m) - m) + a7 u^2 + a8 u v + a9 v^2

with m the rendered print, 0 to 1, and (u, v) the place of the pixel p in the print; a4 to a6 are the camera's tone
curve, which leaves black and white as they are: to third order, and a logarithm l(m) that lifts the dark as a gamma
does. What should be blown is left out, and a7 to a9 are asked only where something is: a highlight's slope. B is a
covariance `(2, 2)`: motion blur is longer one way. Under a rolling shutter the camera's motion while the rows are read
is fitted too.

Source: direct alignment, Lucas and Kanade, IJCAI 1981; Gauss-Newton with Levenberg damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import APART2, LIMITS
from mkdaemon.vision.pose.edgefind import HALF_WIDTH
from mkdaemon.vision.pose.photostep import Part, PhotoStep, lit_print, matched, of_all
from mkdaemon.vision.pose.pose import Pose, apart, length2
from mkdaemon.vision.pose.prints import PrintModel, Prints, principal
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import Level, Prior, State, Unknown, not_arrived
from mkdaemon.vision.tags.tagmap import Target

START_BLUR_PX = 0.7
BLUR_PX = (0.35, 12.0)
"""Point spread that is modelled, deviation [px]: streaks up to 41 px."""
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-7, 1e-2
"""Levenberg's share of the diagonal: at first, at least, and the last from which a worse step is tried again."""
EASE, TIGHTEN = 0.3, 30.0
"""Factors on the damping after a better and a worse step."""
WORSE_COST = 1.003
"""A step whose cost rises by less is no worse: the fit has settled."""
NEARER = 0.25
"""Of squared lengths: a state from which the next step is half as long is nearer, whatever its cost. Source: natural
monotonicity test, Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004, 3.3."""
UNSETTLED = 1.0
"""Squared deviations from its place from which a fit that ended has not arrived."""
STEPS = 8
"""Of a fit; four are usual, a streak of 20 px takes eight (of 9,536 images five lost 6, 10 to 20 won none)."""
SETTLED = 0.3
"""A shorter step is the last: squared length in deviations of the fit."""


class PhotoFit:
    """Fits the pose of one target to the grey values of all its prints in the image."""

    def __init__(self, target: Target, projection: Projection) -> None:
        self._target, self._projection = target, projection
        self._halved: PhotoFit | None = None
        self.prints = Prints(target, projection)
        self._shutter = projection.shutter

    def fit(self, pixels: Grey, start: Pose, level: Level | None = None, blur_px: float | None = None) -> Pose | None:
        """Refine a pose; large cells in an image of half the size.

        Args:
            pixels: `(h, w)` uint8.
            start: within about a cell of the truth.
            level: where the target's normal should point.
            blur_px: deviation of the point spread to begin with; that of the start, where grey values gave it, if none.

        Returns:
            The pose, `rms_px` being the residual over the contrast; none when the print is not in full view, too large
            for this method, or does not resemble the image where the fit starts.
        """
        # Cells of half the size are still fitted by grey values where a streak or a steep view has melted them.
        cells = LIMITS.cells
        shortest = self.prints.cell_px(start) * float(np.cos(self.prints.looked_at(start)[2]))
        is_melted = blur_px is not None and shortest < cells.melted_widths * HALF_WIDTH * blur_px
        if shortest < (cells.mixed_px if is_melted else 2.0 * cells.photometric_px):
            return self.fit_whole(pixels, start, level, blur_px)
        if self._halved is None:
            self._halved = PhotoFit(self._target, self._projection.halved())
        height, width = pixels.shape
        whole = pixels[: height // 2 * 2, : width // 2 * 2]
        half = np.asarray(cv2.resize(whole, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        begin = replace(start, blur_px=None if start.blur_px is None else start.blur_px / 2)
        found = self._halved.fit_whole(half, begin, level, None if blur_px is None else blur_px / 2)
        if found is None or found.blur_px is None:
            return None
        return replace(found, rms_px=2.0 * found.rms_px, blur_px=2.0 * found.blur_px)

    def fit_whole(
        self, pixels: Grey, start: Pose, level: Level | None = None, blur_px: float | None = None
    ) -> Pose | None:
        """The same on all pixels, however large the cells are; see `fit`."""
        known = start.blur_px if start.source == "photometric" else None
        prior = Prior(start, level, self._shutter, self.prints.sheet)
        at = prior.begin(blur_px or known or START_BLUR_PX)
        seen = self.prints.seen(at.rotation, at.position)
        near = seen if len(seen) == 1 else self._alike(pixels, seen, at, LIMITS.likeness.alike) or seen
        found = self._fit(pixels, near, at, prior)
        if found is None or len(self.prints.all) == 1:
            return found
        seen = self.prints.seen(found.rotation, found.position)
        shown = self._alike(pixels, seen, _state_of(found), LIMITS.likeness.clear)
        if shown and set(shown) != set(near):
            found = self._fit(pixels, shown, _state_of(found), prior)
        return None if found is None or not shown else self._with_missing(found, seen, shown)

    def _with_missing(self, pose: Pose, seen: Sequence[PrintModel], shown: Sequence[PrintModel]) -> Pose:
        """The pose with what speaks against it: prints that it puts into the image and that are not shown."""
        size = {model: (model.half / model.depth(pose.rotation, pose.position)) ** 2 for model in {*seen, *shown}}
        share = sum(size[model] for model in shown) / sum(size.values())
        loss = pose.loss**share * LIMITS.photo.lost_grey ** (2.0 * (1.0 - share))
        return replace(pose, inliers=share * pose.inliers, loss=loss)

    def _fit(self, pixels: Grey, prints: Sequence[PrintModel], at: State, prior: Prior) -> Pose | None:
        """The pose where a fit to some prints ends."""
        damping, last, left = FIRST_DAMPING, np.inf, np.inf
        best: tuple[State, PhotoStep] | None = None
        for _ in range(STEPS):
            step = self.step(pixels, prints, at, prior)
            if step is None or (best is None and step.match < LIMITS.likeness.alike):
                return None
            # Pixels that come and go at the rim change the cost, too, and a valley that bends lies beyond a rise: then
            # the shorter step is nearer.
            if step.cost < last or step.length2 < NEARER * left:
                best, last, left = (at, step), step.cost, step.length2
                damping = max(damping * EASE, LEAST_DAMPING)
            elif best is None or damping > MOST_DAMPING or step.cost < last * WORSE_COST:
                break
            else:
                at, step = best
                damping *= TIGHTEN
            change = step.change(damping)
            spread = _spread_moved(at.spread, change[step.unknowns["spread"]])
            at = replace(at.moved(step.unknowns, change), spread=spread)
            if step.length2 < SETTLED:
                best = at, step
                break
            if at.ran_away(prior.start):
                return None
        if best is None:
            return None
        at, step = best
        fitted = step.pose(at, prior)
        return not_arrived(fitted, step.to_go) if left > UNSETTLED else fitted

    def step(self, pixels: Grey, prints: Sequence[PrintModel], at: State, prior: Prior) -> PhotoStep | None:
        """One step; pose, spread and motion are those of all prints, each has its own light.

        None where no print is seen whole.
        """
        parts = [part for part in (self._part(pixels, model, at) for model in prints) if part is not None]
        if not parts:
            return None
        contrast = of_all([part.contrast for part in parts])
        by_point = contrast * of_all([part.at.by_point for part in parts])
        times = self._projection.row_times(of_all([part.at.row for part in parts]))
        sheet = self.prints.sheet
        heights = None if sheet is None else sheet.heights(*(prints[0].cell * parts[0].at.place))
        # Columns that lie together in memory are added and multiplied faster than rows of three.
        table = prior.table(at, by_point.T, of_all([part.at.arm for part in parts]).T, times, heights)
        table.insert(2, Unknown("spread", contrast * of_all([part.at.by_spread for part in parts])))
        light, row, end = np.zeros((sum(len(part.gain) for part in parts), contrast.size)), 0, 0
        for part in parts:
            start, end = end, end + part.at.grey.size
            light[row : row + len(part.gain), start:end] = part.columns
            row += len(part.gain)
        return PhotoStep(parts, [*table, Unknown("light", light)], at)

    def _part(self, pixels: Grey, model: PrintModel, at: State) -> Part | None:
        """What one print says; none where it is not in full view, or has too few pixels."""
        seen = model.samples(pixels, at.rotation, at.position, at.spread, at.motion)
        part = None if seen is None else lit_print(seen)
        return part if part is not None and part.at.grey.size >= LIMITS.photo.min_window_px**2 else None

    def _alike(self, pixels: Grey, prints: Sequence[PrintModel], at: State, least: float) -> tuple[PrintModel, ...]:
        """Of several prints those that the image shows at a state: hidden and missed ones would lead a fit astray."""
        parts = [(model, self._part(pixels, model, at)) for model in prints]
        return tuple(model for model, part in parts if part is not None and matched([part], part.residual) >= least)

    def resembles(self, grey: Pose) -> bool:
        """Whether the model of a fit to grey values looks like the image."""
        return grey.likeness is not None and grey.likeness >= LIMITS.likeness.explained

    def explains(self, grey: Pose) -> bool:
        """Whether the model holds for a fit to grey values: nothing lies over the print or shines on it."""
        return self.resembles(grey) and grey.inliers >= LIMITS.agreement.whole

    def polish(self, pixels: Grey, pose: Pose) -> Pose:
        """A pose from edges with place and covariance by grey values, where these know more and edges do not object.

        Cells of five to ten pixels have few edges; the pixels between tell as much again. Edges of smaller cells melt
        and object to nothing. Under a rolling shutter pixels know a first image's motion no better.

        Args:
            pixels: `(h, w)` uint8.
            pose: fitted to edges, whole target in view; given back where grey values do not improve it.
        """
        limits, whole = LIMITS, LIMITS.agreement.whole
        cell_px = self.prints.cell_px(pose)
        if self._shutter.rolls or pose.source != "edges" or cell_px > limits.cells.small_px or pose.inliers < whole:
            return pose
        grey = self.fit_whole(pixels, pose)
        if grey is None or not self.explains(grey):
            return pose
        if float(np.linalg.det(grey.covariance)) >= float(np.linalg.det(pose.covariance)):
            return pose
        if length2(apart(pose, grey), pose.covariance) > APART2 and cell_px >= limits.cells.mixed_px:
            return pose
        return replace(pose, rotation=grey.rotation, position=grey.position, covariance=grey.covariance, bend=grey.bend)


def _state_of(pose: Pose) -> State:
    """Where a fit to several prints, which do not bend, has put them."""
    return State(pose.rotation, pose.position, (pose.blur_px or START_BLUR_PX) ** 2 * np.eye(2), pose.motion)


def _spread_moved(spread: Array, change: Array) -> Array:
    """A point spread `(2, 2)` after a step `(3,)`; it stays one."""
    xx, xy, yy = change
    least, most, way = principal(spread + np.array([[xx, xy], [xy, yy]]))
    least, most = (min(max(variance, BLUR_PX[0] ** 2), BLUR_PX[1] ** 2) for variance in (least, most))
    return np.asarray(least * np.eye(2) + (most - least) * np.outer(way, way), np.float64)
