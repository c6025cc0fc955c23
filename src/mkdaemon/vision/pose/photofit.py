"""Pose refinement on every pixel of a small tag.

Below four pixels a cell edges melt into each other and a located edge means little. Here the known print is rendered
through pose, pixel area and point spread, and pose x, light a and point spread B are fitted to the grey values at once:

    I(p) = a0 m(p; x, B) + a1 + a2 u + a3 v + m (1 - m) (a4 + a5 (1 - 2 m)) + a6 (l(m) - m) + a7 u^2 + a8 u v + a9 v^2

with m the rendered print, 0 to 1, and (u, v) the place of the pixel p in the print; a4 to a6 are the camera's tone
curve, which leaves black and white as they are: to third order, and a logarithm l(m) that lifts the dark as a gamma
does. What should be blown is left out, and a7 to a9 are asked only where something is: a highlight's slope. B is a
covariance `(2, 2)`: motion blur is longer one way. Under a rolling shutter the camera's motion while the rows are read
is fitted too. Light, and what a motion lacks, are solved again at every state, both at once: images are linear in
them. The noise of a fit depends on brightness, and neighbouring pixels share it.

Source: direct alignment, Lucas and Kanade, IJCAI 1981; Gauss-Newton with Levenberg damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, sqrt
from typing import Final

import cv2
import numpy as np

from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.limits import APART2, HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.pose.ambiguity import loss_of
from mkdaemon.vision.pose.edgefind import HALF_WIDTH
from mkdaemon.vision.pose.edgefit import MAD
from mkdaemon.vision.pose.pose import LEAST_NORM, Pose, apart, correlation, damped, inverted, length2, median
from mkdaemon.vision.pose.prints import BOX, PrintModel, Prints, PrintSamples, principal
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import POSE, SETTLED, Prior, State, TargetLevel, UnknownRow, Unknowns, not_arrived
from mkdaemon.vision.tags.tagmap import Target

DARK, BRIGHT = 0.3, 0.7
"""Values of the model whose residuals give the noise of black and of white."""
LEAST_PIXELS = 20
"""That tell a noise."""
LEAST_SCATTER = 0.5
"""Of pixels that are rounded to grey values."""
MOST_RATIO = 5.0
"""Of the noise of black and white."""
MOST_SHARED = 0.7
"""Correlation of neighbouring residuals, at most, and of residuals that hold nothing but what the model lacks."""
LEAST_ON_SLOPES = 0.5
"""Variance of residuals on slopes, over that of all: it is 0.7-0.9 behind gamma 2.2, above 1 elsewhere."""
LEAST_SHARED = -0.5
"""The same where sharpening has set the noise of neighbours against each other: webcams have -0.2."""

STREAK_PX = 15.0
"""A streak this long doubles the variance of a fit; by the NEES of 819 smeared images (docs/lab/vision-fits.md)."""


def clarity(residual: Array, value: Array) -> Array:
    """By how much a pixel is less noisy than the mean one `(n,)`: a tone curve spreads the noise of dark pixels.

    Args:
        residual: of each pixel `(n,)` [grey].
        value: of the model there, 0 black to 1 white `(n,)`.
    """
    dark, bright = np.abs(residual[value < DARK]), np.abs(residual[value > BRIGHT])
    if min(dark.size, bright.size) < LEAST_PIXELS:
        return np.ones_like(value)
    ratio = max(median(dark), LEAST_SCATTER) / max(median(bright), LEAST_SCATTER)
    ratio = min(max(ratio, 1.0 / MOST_RATIO), MOST_RATIO)
    clear: Array = 1.0 / (ratio + (1.0 - ratio) * value)
    return clear / sqrt(float(clear @ clear) / clear.size)


def shared_by(residual: Array, windows: Sequence[Bools], least: float = 0.0) -> tuple[float, float]:
    """Correlation of neighbouring residuals of a fit; over several prints the mean of their pixels.

    Demosaicing, denoising and what the model lacks are shared; the noise of a sensor is not. Where the correlation
    falls by r from a pixel to the next, the variance of a mean is (1 + r) / (1 - r) times that of independent pixels,
    each way; edges, which change over a few pixels, suffer less: (1 + r) / sqrt(1 - r), by the NEES of 80 images.
    Sharpening makes r < 0.

    Args:
        residual: of each used pixel of all windows, one window after the other `(n,)`.
        windows: which pixels of each are used, each `(rows, columns)`.
        least: correlation that is accepted.

    Returns:
        The factor on the variance of a fit, less than 1 where neighbours contradict each other; and the share of the
        variance of a residual, not less than this number of pixels can distinguish from zero.
    """
    all_factors, all_common, start = 0.0, 0.0, 0
    for used in windows:
        height, width = used.shape
        image = np.zeros((height, width + 1))  # rows with a gap between them, one after the other
        count = int(np.count_nonzero(used))
        image[:, :-1][used] = residual[start : start + count]
        start, image = start + count, image.ravel()
        total = max(float(image @ image), LEAST_SCATTER)
        factor, common = 1.0, 0.0
        for gap in (1, width + 1):
            r = min(max(float(image[gap:] @ image[:-gap]) / total, least), MOST_SHARED)
            factor *= (1.0 + r) / sqrt(1.0 - r)
            common += max(r, 0.0) / MOST_SHARED / 2.0
        share = count / residual.size
        all_factors += share * factor
        all_common += share * min(max(common, 1.0 / sqrt(max(count, 1))), 1.0)
    return all_factors, all_common


def on_slopes(residual: Array, steep: Array) -> tuple[Array, float]:
    """Residuals on the slopes of a print `(n,)`, and their variance over that of all.

    Only slopes tell a pose, and what the model lacks lies there; the even inside of cells knows nothing of it.

    Args:
        residual: of each used pixel `(n,)`.
        steep: squared slope of the model there `(n,)`.
    """
    weighed = residual * np.sqrt(steep / max(float(steep.sum()) / steep.size, 1e-12))
    larger = float(weighed @ weighed) / max(float(residual @ residual), LEAST_SCATTER)
    return weighed, max(larger, LEAST_ON_SLOPES)


def streak_doubt(spread: Array) -> float:
    """Factor on the variance of a fit for what a streak hides: it differs over the print, and its rim has ground in it.

    Args:
        spread: covariance of the point spread `(2, 2)` [px^2]; an even streak of length L adds L^2 / `BOX` one way.
    """
    least, most, _ = principal(spread)
    return 1.0 + (BOX * (most - least) / STREAK_PX**2) ** 2


TOE: Final = 0.05
"""Light of ink over that of paper: with a logarithm from there the model follows a gamma of 1.6 to 2.2 to 0.3 % of the
contrast, a cubic polynomial alone to 0.7-3.4 % (ink 0.03 to 0.1)."""
TOE_GAIN: Final = 1.0 / float(np.log1p(1.0 / TOE))


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Equations of one print: the model of its grey values is I = gain . columns.

    Attributes:
        at: model and image at its pixels.
        columns: of each unknown of the light `(k, n)`: white over black, black, two gradients, three of the tone curve,
            and three of a highlight's slope where there may be one.
        gain: the light `(k,)`.
    """

    at: PrintSamples
    columns: Array
    gain: Array

    @property
    def residual(self) -> Array:
        """Of each pixel `(n,)` [grey]."""
        return self.at.grey - self.gain @ self.columns

    @property
    def contrast(self) -> Array:
        """Change of the grey values by a change of the print `(n,)`."""
        white, _, _, _, second, third, toe = self.gain[:7].tolist()
        value = self.at.value
        # With the columns of `lit_print`: d/dv of v(1-v) is 1 - 2v, of v(1-v)(1-2v) it is 1 - 6v + 6v^2, and of the toe
        # TOE_GAIN / (TOE + v) - 1.
        polynomial = value * (6.0 * third * value - (2.0 * second + 6.0 * third)) + (white + second + third - toe)
        return np.asarray(polynomial + toe * TOE_GAIN / (TOE + np.maximum(value, 0.0)), np.float64)


def lit_print(at: PrintSamples) -> Part:
    """The light on a print, by least squares on its pixels without those that should be blown: these may be anything.

    What should be blown follows from the light on the other pixels, and left out whether it is or not: the others would
    be too dark by their noise. A blown pixel that should be dark stays, as a dark one that should be blown, and speaks
    against the pose. Where nothing is blown slopes are even: ground beside its shadow would look like a lit print.
    """
    tone, (u, v) = at.value * (1.0 - at.value), at.place
    # grey = w v + b + s u + t v' + c2 v(1-v) + c3 v(1-v)(1-2v) + c4 toe(v), v the print, (u, v') the place on it:
    # light with a slope, behind a tone curve to third order with a logarithm near black. Linear in w, b, s, t, c.
    toe = TOE_GAIN * np.log1p(np.maximum(at.value, 0.0) / TOE) - at.value
    columns = np.array([at.value, np.ones_like(u), u, v, tone, tone * (1.0 - 2.0 * at.value), toe])
    keep = at.grey < LIMITS.read.saturated
    if bool(keep.all()):
        return Part(at, columns, _gain(columns, at.grey))
    columns = np.array([*columns, u * u, u * v, v * v])
    dark = at.grey < LIMITS.read.saturated - 2.0 * LIMITS.read.nearly_blown
    shown = _gain(columns[:, keep], at.grey[keep]) @ columns
    keep = dark | (shown < LIMITS.read.saturated - LIMITS.read.nearly_blown)
    kept, columns = at.kept(keep), columns[:, keep]
    return Part(kept, columns, _gain(columns, kept.grey))


def _gain(columns: Array, grey: Array) -> Array:
    """The light that explains grey values best `(k,)`."""
    return np.asarray(np.linalg.solve(damped(columns @ columns.T), columns @ grey), np.float64)


SEEN: Final = slice(0, 9)
"""Pose and point spread among the unknowns: readings compare by what both leave, so neither may be on its way."""
LEAST_NOISE: Final = 0.3
"""Variance of grey values rounded to integers and averaged by the fit [grey^2]."""


class PhotoStep:
    """One robust Gauss-Newton step, to be damped.

    Residuals by their clarity weigh 1 within c sigma, (c sigma / r)^2 beyond, sigma from the median of |r|.

    Args:
        parts: what each print says.
        table: unknowns of the grey values, the light last.
        at: where the step starts.

    Attributes:
        unknowns: of the grey values.
        cost: robust mean square of the residuals before the step [grey^2], with what prior knowledge adds, and a
            clarity of mean logarithm zero: a cost by which two states compare, each with its own clarity.
        to_go: what of the pose would change without damping: how far it is from its place `(6,)`.
        length2: of that, in deviations that the noise leaves, squared.
        is_settled: whether neither the pose nor the point spread has far to go.
    """

    def __init__(self, parts: Sequence[Part], table: Sequence[UnknownRow], at: State) -> None:
        self._parts = parts
        self._residual, table = _without_lacking(of_all([part.residual for part in parts]), table, at)
        unknowns, count = Unknowns(table), self._residual.size
        clear = clarity(self._residual, of_all([part.at.value for part in parts]))
        shown = self._residual * clear
        # Huber's weights with sigma = 1.4826 median |r|. Source: P. Huber, Robust Statistics, 1981, section 7.8.
        self._size = np.maximum(np.abs(shown), 1e-6)
        self._share = np.minimum(LIMITS.certainty.deviations * max(MAD * median(self._size), 1.0) / self._size, 1.0)
        # Outliers are clipped to the largest residual of what is none.
        clipped = shown * self._share
        squares = float(clipped @ clipped)
        weights = (self._share * clear) ** 2
        # Variance by the degrees of freedom that are left, then what neighbouring pixels share, and slopes alone.
        noise = max(squares / max(float(weights.sum()) - len(unknowns.rows), 1.0), LEAST_NOISE)
        weighed, larger = on_slopes(clipped, of_all([part.at.steep for part in parts]))
        least = LEAST_SHARED if at.motion is None else 0.0  # what a motion lacks hides under opposed noise
        self._shared, self._common = shared_by(weighed, [part.at.used for part in parts], least)
        noise *= larger * self._shared * streak_doubt(at.spread)
        self._normal, self._right = unknowns.equations(weights, self._residual, noise)
        inverse = inverted(self._normal)
        self.unknowns, self._inverse, self._weights, self._noise = unknowns, inverse, weights, noise
        # A Gauss-Newton step; its length counts in deviations that the noise leaves: dx^T (noise C)^-1 dx.
        to_go = inverse @ self._right
        self.to_go = to_go[POSE]
        self.length2 = length2(self.to_go, noise * inverse[POSE, POSE])
        seen2 = length2(to_go[SEEN], noise * inverse[SEEN, SEEN])
        self.is_settled = self.length2 < SETTLED and seen2 < UNSETTLED
        self._square = squares / count
        clearness = exp(2.0 * float(np.log(clear).sum()) / count)
        self.cost = self._square / clearness * (1.0 + unknowns.surprise / count)

    @property
    def match(self) -> float:
        """Correlation of image and model; -1 for a negative."""
        return matched(self._parts, self._residual)

    def change(self, damping: float) -> Array:
        """Of all unknowns `(k,)`."""
        normal = self._normal.copy()
        normal.reshape(-1)[:: len(normal) + 1] *= 1.0 + damping
        return np.asarray(np.linalg.solve(normal, self._right), np.float64)

    def pose(self, at: State, prior: Prior) -> Pose:
        """The pose of the state the step starts from, or of where it led, with what was known beforehand."""
        is_agreeing, match = self._share**2 > HALF, self.match
        # With c^2 = S / (S + N) of a model of variance S and residuals of variance N, of which r N are shared, the
        # square of the likeness is S / (S + r N).
        likeness = match / sqrt(max(match**2 + self._common * (1.0 - match**2), LEAST_NORM))
        # Residual as a shift of edges: rms over the rms slope of the lit prints [grey / (grey/px)].
        steepness = sqrt(sum(float(p.at.steep.sum()) * float(p.gain[0]) ** 2 for p in self._parts) / self._size.size)
        every = self.unknowns.covariance(self._inverse, self._weights, self._noise)
        covariance, bend = prior.measured(at, self.unknowns, every)
        return Pose(
            at.rotation,
            at.position,
            covariance,
            "photometric",
            int(is_agreeing.sum()),
            sqrt(self._square) / max(steepness, 1e-3) if match > -1.0 else np.inf,
            float(is_agreeing.mean()),
            float(np.linalg.norm(self.to_go[:3])) / max(float(np.linalg.norm(at.position)), 1e-9),
            loss_of(self._size, LIMITS.photo.lost_grey, NOISE_GREY),
            likeness,
            float(np.linalg.det(at.spread)) ** 0.25,
            cost=self.cost,
            motion=at.motion,
            known_motion=prior.start.known_motion,
            bend=bend,
            known_bend=prior.bend,
            shared=self._shared,
            common=self._common,
        )


def matched(parts: Sequence[Part], residual: Array) -> float:
    """Correlation of an image with what it shows of prints, less residuals `(n,)`; -1 for a negative."""
    if not all(part.gain[0] > 0.0 for part in parts):
        return -1.0
    grey = of_all([part.at.grey for part in parts])
    return correlation(grey, grey - residual)


def of_all(rows: Sequence[Array]) -> Array:
    """Values of the pixels of all prints `(n,)` or `(k, n)`, one print after the other."""
    return rows[0] if len(rows) == 1 else np.concatenate(rows, axis=-1)


def _without_lacking(residual: Array, table: Sequence[UnknownRow], at: State) -> tuple[Array, list[UnknownRow]]:
    """Residuals without what the bend does and the motion lacks `(n,)` [grey], and the table as it is for these."""
    line = {unknown.name: unknown for unknown in table}
    if at.rise is not None:
        # The print is rendered flat; its bend moves what is seen by less than a pixel.
        residual = residual - at.rise @ line["rise"].rows
    if at.motion is None:
        return residual, list(table)
    # What the motion lacks and the light that explain the residuals best, both at once.
    both = Unknowns([line["beyond"], line["light"]])
    scatter = max(MAD * median(np.abs(residual)), 1.0)
    weights = 1.0 / np.maximum((residual / (LIMITS.certainty.deviations * scatter)) ** 2, 1.0)
    refitted = np.asarray(np.linalg.solve(*both.equations(weights, residual, scatter**2)), np.float64)
    # Of what the motion lacks the residual holds no more than is beside what was taken out.
    line["beyond"] = replace(line["beyond"], off=-refitted[both["beyond"]])
    return residual - refitted @ both.rows, list(line.values())


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


class PhotoFit:
    """Fits the pose of one target to the grey values of all its prints in the image."""

    def __init__(self, target: Target, projection: Projection) -> None:
        self._target, self._projection = target, projection
        self._halved: PhotoFit | None = None
        self.prints = Prints(target, projection)

    def fit(
        self,
        pixels: Grey,
        start: Pose,
        level: TargetLevel | None = None,
        blur_px: float | None = None,
        rival: Pose | None = None,
    ) -> Pose | None:
        """Refine a pose; large cells in an image of half the size.

        Args:
            pixels: `(h, w)` uint8.
            start: within about a cell of the truth.
            level: where the target's normal should point.
            blur_px: deviation of the point spread to begin with; that of the start, where grey values gave it, if none.
            rival: pose that the fit will be compared with, and takes the size of the image from.

        Returns:
            The pose, `rms_px` being the residual over the contrast; none when the print is not in full view, too large
            for this method, or does not resemble the image where the fit starts.
        """
        # Cells of half the size are still fitted by grey values where a streak or a steep view has melted them.
        cells = LIMITS.cells
        shortest = self.prints.cell_px(start) * float(np.cos(self.prints.looked_at(start)[2]))
        is_melted = blur_px is not None and shortest < cells.melted_widths * HALF_WIDTH * blur_px
        is_small = shortest < (cells.mixed_px if is_melted else 2.0 * cells.photometric_px)
        if is_small if rival is None else not rival.is_halved:
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
        return replace(found, rms_px=2.0 * found.rms_px, blur_px=2.0 * found.blur_px, is_halved=True)

    def fit_whole(
        self, pixels: Grey, start: Pose, level: TargetLevel | None = None, blur_px: float | None = None
    ) -> Pose | None:
        """The same on all pixels, however large the cells are; see `fit`."""
        known = start.blur_px if start.source == "photometric" else None
        prior = Prior(start, level, self._projection, self.prints.sheet)
        at = prior.begin(blur_px or known or START_BLUR_PX)
        seen = self.prints.seen(at.rotation, at.position)
        near = seen if len(seen) == 1 else self._alike(pixels, seen, at, LIMITS.likeness.alike) or seen
        found = self._fit(pixels, near, at, prior)
        if found is None or len(self.prints.all) == 1:
            return found
        seen = self.prints.seen(found.rotation, found.position)
        # The best of them says what is right here; what is hidden in part still looks like a print.
        at = Prior(found, level, self._projection, self.prints.sheet).begin(found.blur_px or START_BLUR_PX)
        shown = self._alike(pixels, seen, at, LIMITS.likeness.clear, LIMITS.likeness.explained)
        if shown and set(shown) != set(near):
            found = self._fit(pixels, shown, at, prior)
        return None if found is None or not shown else self._with_missing(found, seen, shown)

    def _with_missing(self, pose: Pose, seen: Sequence[PrintModel], shown: Sequence[PrintModel]) -> Pose:
        """The pose with what speaks against it: prints that it puts into the image and that are not shown."""
        size = {model: (model.tag.paper / model.depth(pose.rotation, pose.position)) ** 2 for model in {*seen, *shown}}
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
            # Pixels that appear or vanish at the rim change the cost, and a valley that bends lies beyond a rise: then
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
            if step.is_settled:
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
        heights = None if sheet is None else sheet.heights(*(prints[0].tag.module * parts[0].at.place))
        # Columns that lie together in memory are added and multiplied faster than rows of three.
        arm, error_px = of_all([part.at.arm for part in parts]).T, LIMITS.edges.systematic_px
        table = prior.table(at, by_point.T, arm, times, heights, error_px)
        table.insert(2, UnknownRow("spread", contrast * of_all([part.at.by_spread for part in parts])))
        light, row, end = np.zeros((sum(len(part.gain) for part in parts), contrast.size)), 0, 0
        for part in parts:
            start, end = end, end + part.at.grey.size
            light[row : row + len(part.gain), start:end] = part.columns
            row += len(part.gain)
        return PhotoStep(parts, [*table, UnknownRow("light", light)], at)

    def _part(self, pixels: Grey, model: PrintModel, at: State) -> Part | None:
        """What one print says; none where it is not in full view, or has too few pixels."""
        seen = model.samples(pixels, at.rotation, at.position, at.spread, at.motion)
        part = None if seen is None else lit_print(seen)
        return part if part is not None and part.at.grey.size >= LIMITS.photo.min_window_px**2 else None

    def _alike(
        self, pixels: Grey, prints: Sequence[PrintModel], at: State, least: float, share: float = 0.0
    ) -> tuple[PrintModel, ...]:
        """Of several prints those that the image shows at a state: hidden and missed ones would lead a fit astray.

        They correlate by at least `least`, and by such a share of the best one.
        """
        parts = [(model, self._part(pixels, model, at)) for model in prints]
        likeness = {model: matched([part], part.residual) for model, part in parts if part is not None}
        least = max(least, share * max(likeness.values(), default=0.0))
        return tuple(model for model, value in likeness.items() if value >= least)

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
        """
        is_whole = pose.source == "edges" and pose.inliers >= LIMITS.agreement.whole
        cell_px = self.prints.cell_px(pose)
        if self._projection.shutter.rolls or not is_whole or cell_px > LIMITS.cells.small_px:
            return pose
        grey = self.fit_whole(pixels, pose)
        if grey is None or not self.explains(grey):
            return pose
        if float(np.linalg.det(grey.covariance)) >= float(np.linalg.det(pose.covariance)):
            return pose
        if length2(apart(pose, grey), pose.covariance) > APART2 and cell_px >= LIMITS.cells.mixed_px:
            return pose
        return replace(pose, rotation=grey.rotation, position=grey.position, covariance=grey.covariance, bend=grey.bend)


def _spread_moved(spread: Array, change: Array) -> Array:
    """A point spread `(2, 2)` after a step `(3,)`; it stays one."""
    xx, xy, yy = change
    least, most, way = principal(spread + np.array([[xx, xy], [xy, yy]]))
    least, most = (min(max(variance, BLUR_PX[0] ** 2), BLUR_PX[1] ** 2) for variance in (least, most))
    return np.asarray(least * np.eye(2) + (most - least) * np.outer(way, way), np.float64)
