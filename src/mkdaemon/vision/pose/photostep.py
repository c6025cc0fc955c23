"""One step of the fit to grey values: what the model says at each pixel, and where that moves pose, light and blur.

The noise of grey values after a fit: how it depends on brightness, and over how many pixels it is shared.

What every state of a fit to grey values asks for anew: light, and what a motion lacks, in which images are linear.

Neither is carried from step to step. A state is as good as its best light and its best motion together: with the light
told first, and then what the motion lacks by what the light had left, costs rose along steps that led to the place, and
fits ended beside it.

The light on a print: black, white, how it changes over the print, and the tone curve of the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, sqrt
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.pose.edgestep import MAD
from mkdaemon.vision.pose.pose import Pose, correlation, damped, inverted, length2, median
from mkdaemon.vision.pose.prints import BOX, PrintModel, PrintSamples, principal
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import POSE, Prior, State, Unknown, Unknowns

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
"""Variance of residuals on slopes, over that of all: few pixels tell it where hardly a slope is in view (0.7-0.9 behind
gamma 2.2, above 1 elsewhere)."""
LEAST_SHARED = -0.5
"""The same where sharpening has set the noise of neighbours against each other: webcams have -0.2."""

STREAK_PX = 15.0
"""A streak so long doubles the variance of a fit; by the NEES of 819 smeared images of 29 development flights: 1.2 to
12 px, 2.3 at 14, 3.2 at 18, 5 at 25."""


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


@dataclass(frozen=True, slots=True)
class SharedNoise:
    """What neighbouring residuals have in common.

    Attributes:
        factor: by which that raises the variance of a fit; less than 1 where neighbours contradict each other.
        common: share of the variance of a residual, 0 to 1; not less than so many pixels can tell from none.
    """

    factor: float
    common: float


def shared_by(residual: Array, windows: Sequence[Bools], least: float = 0.0) -> SharedNoise:
    """What neighbours share of the residuals of a fit; over several prints the mean of their pixels.

    Demosaicing, denoising and what the model lacks are shared; the noise of a sensor is not. Where the correlation
    falls by r from a pixel to the next, the variance of a mean is (1 + r) / (1 - r) times that of independent pixels,
    each way; edges, which change over a few pixels, suffer less: (1 + r) / sqrt(1 - r), by the NEES of 80 development
    images (0.66 to 1.19). Sharpening sets the noise of neighbours against each other, r < 0, and a mean has less of it.

    Args:
        residual: of each used pixel of all windows, one window after the other `(n,)`.
        windows: which pixels of each are used, each `(rows, columns)`.
        least: correlation that is believed.
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
        for apart in (1, width + 1):
            r = min(max(float(image[apart:] @ image[:-apart]) / total, least), MOST_SHARED)
            factor *= (1.0 + r) / sqrt(1.0 - r)
            common += max(r, 0.0) / MOST_SHARED / 2.0
        share = count / residual.size
        all_factors += share * factor
        all_common += share * min(max(common, 1.0 / sqrt(max(count, 1))), 1.0)
    return SharedNoise(all_factors, all_common)


def shared_on_slopes(residual: Array, steep: Array, windows: Sequence[Bools], least: float = 0.0) -> float:
    """By how much the residuals on the slopes of a print raise the variance of a fit, as `SharedNoise.factor`.

    Only slopes tell a pose, and what the model lacks of a point spread, of paper that is blown beside them or of
    sharpening lies there; the even inside of cells from 5 px, most of what is seen, knows nothing of it. Behind a tone
    curve slopes are less noisy (0.8 of the variance) than `clarity` makes of black and white.

    Args:
        residual: of each used pixel of all windows `(n,)`.
        steep: squared slope of the model there `(n,)`.
        windows: which pixels of each are used, each `(rows, columns)`.
        least: correlation that is believed.
    """
    weighed = residual * np.sqrt(steep / max(float(steep.sum()) / steep.size, 1e-12))
    larger = max(float(weighed @ weighed) / max(float(residual @ residual), LEAST_SCATTER), LEAST_ON_SLOPES)
    return larger * shared_by(weighed, windows, least).factor


def streak_doubt(spread: Array) -> float:
    """Factor on the variance of a fit for what a streak hides: it differs over the print, and its rim has ground in it.

    Args:
        spread: covariance of the point spread `(2, 2)` [px^2]; an even streak of length L adds L^2 / `BOX` one way.
    """
    least, most, _ = principal(spread)
    return 1.0 + (BOX * (most - least) / STREAK_PX**2) ** 2


ROUNDS: Final = 3
"""Of telling which pixels are blown, each by the light on the others (two give the same to 1 %)."""
TOE: Final = 0.05
"""Light of ink over that of paper: where a tone curve lifts the dark. With a logarithm from there the model follows a
gamma of 1.6 to 2.2 to 0.3 % of the contrast, a cubic polynomial alone to 0.7-3.4 % (ink 0.03 to 0.1)."""
TOE_GAIN: Final = 1.0 / float(np.log1p(1.0 / TOE))


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """What one print says: the model of its grey values is I = gain . columns.

    Attributes:
        at: model and image at its pixels.
        columns: what each unknown of the light adds to them `(k, n)`: white over black, black, two gradients, three of
            the tone curve, and three of a highlight's slope where there may be one.
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
    def brightness(self) -> float:
        """Of its white over its black [grey]."""
        return float(self.gain[0])

    @property
    def contrast(self) -> Array:
        """What a change of the print changes in the grey values `(n,)`."""
        white, _, _, _, second, third, toe = self.gain[:7].tolist()
        value = self.at.value
        polynomial = value * (6.0 * third * value - (2.0 * second + 6.0 * third)) + (white + second + third - toe)
        return np.asarray(polynomial + toe * TOE_GAIN / (TOE + np.maximum(value, 0.0)), np.float64)


def lit_print(at: PrintSamples) -> _Part:
    """The light on a print, by least squares on its pixels without those that should be blown: these may be anything.

    What should be blown is told by the light on the other pixels. Under a highlight that is more than black and white:
    its slope lifts the ink by half of the contrast, and edges are blown from differing places on. Pixels that should
    be nearly blown are left out whether they are or not; without the blown ones alone the others would be too dark by
    their noise. A blown pixel that should be dark stays, as a dark one that should be blown, and speaks against the
    pose. Where nothing is blown there is no highlight, and slopes are even: ground beside its shadow would look like a
    print with some light on it.

    Args:
        at: all pixels of a print.
    """
    tone, (u, v) = at.value * (1.0 - at.value), at.place
    toe = TOE_GAIN * np.log1p(np.maximum(at.value, 0.0) / TOE) - at.value
    columns = np.array([at.value, np.ones_like(u), u, v, tone, tone * (1.0 - 2.0 * at.value), toe])
    keep = at.grey < LIMITS.read.saturated
    if bool(keep.all()):
        return _Part(at, columns, _gain(columns, at.grey))
    columns = np.array([*columns, u * u, u * v, v * v])
    dark = at.grey < LIMITS.read.saturated - 2.0 * LIMITS.read.nearly_blown
    for _ in range(ROUNDS):
        shown = _gain(columns[:, keep], at.grey[keep]) @ columns
        keep = dark | (shown < LIMITS.read.saturated - LIMITS.read.nearly_blown)
    kept, columns = at.kept(keep), columns[:, keep]
    return _Part(kept, columns, _gain(columns, kept.grey))


def _gain(columns: Array, grey: Array) -> Array:
    """The light that explains grey values best `(k,)`."""
    return np.asarray(np.linalg.solve(damped(columns @ columns.T), columns @ grey), np.float64)


LEAST_NOISE: Final = 0.3
"""Variance of grey values rounded to integers and averaged by the fit [grey^2]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Weighed:
    """How far residuals are believed.

    Attributes:
        clear: clarity of each pixel `(n,)`.
        size: of each residual, by its clarity `(n,)` [grey].
        share: c sigma / size of outliers, 1 of what is none `(n,)`.
        clipped: residuals by their clarity, outliers as large as what is none `(n,)` [grey].
        squares: sum of these, squared [grey^2].
    """

    clear: Array
    size: Array
    share: Array
    clipped: Array
    squares: float


def _weigh(residual: Array, value: Array, outlier: float) -> _Weighed:
    """Robust weights: 1 within c sigma, (c sigma / r)^2 beyond, sigma from the median of |r|; times the clarity."""
    clear = clarity(residual, value)
    shown = residual * clear
    size = np.maximum(np.abs(shown), 1e-6)
    share = np.minimum(outlier * max(MAD * median(size), 1.0) / size, 1.0)
    clipped = shown * share
    return _Weighed(clear, size, share, clipped, float(clipped @ clipped))


@dataclass(frozen=True, slots=True, eq=False)
class PhotoStep:
    """One Gauss-Newton step, to be damped.

    Attributes:
        unknowns: of the grey values.
        cost: robust mean square of the residuals before the step [grey^2], with what prior knowledge adds, and a
            clarity of mean logarithm zero: a cost by which two states compare, each with a clarity of its own.
        to_go: what of the pose would change without damping: how far it is from its place `(6,)`.
        length2: of that, in deviations of the pose's covariance, squared.
        covariance: of all unknowns `(k, k)`.
    """

    unknowns: Unknowns
    cost: float
    to_go: Array
    length2: float
    covariance: Array
    _normal: Array
    _right: Array
    _parts: Sequence[_Part]
    _residual: Array
    _weighed: _Weighed
    _least_shared: float

    @property
    def match(self) -> float:
        """Correlation of image and model; -1 for a negative."""
        if not all(part.brightness > 0.0 for part in self._parts):
            return -1.0
        grey = np.concatenate([part.at.grey for part in self._parts])
        return correlation(grey, grey - self._residual)

    def change(self, damping: float) -> Array:
        """Of all unknowns `(k,)`."""
        normal = self._normal.copy()
        normal.reshape(-1)[:: len(normal) + 1] *= 1.0 + damping
        return np.asarray(np.linalg.solve(normal, self._right), np.float64)

    def pose(self, at: State, prior: Prior) -> Pose:
        """The pose of the state the step starts from, or of where it led, with what was known beforehand."""
        size, is_agreeing = self._weighed.size, self._weighed.share**2 > HALF
        # Residual as a shift of edges: rms over the rms slope of the lit prints [grey / (grey/px)].
        steepness = sqrt(sum(float(p.at.steep.sum()) * p.brightness**2 for p in self._parts) / size.size)
        squared = np.minimum(size, LIMITS.photo.lost_grey) ** 2 + NOISE_GREY**2
        match = self.match
        covariance, bend = prior.measured(at, self.unknowns, self.covariance)
        shared = shared_by(self._weighed.clipped, [part.at.used for part in self._parts], self._least_shared)
        return Pose(
            at.rotation,
            at.position,
            covariance,
            "photometric",
            int(is_agreeing.sum()),
            sqrt(self._weighed.squares / size.size) / max(steepness, 1e-3) if match > -1.0 else np.inf,
            float(is_agreeing.mean()),
            float(np.linalg.norm(self.to_go[:3])) / max(float(np.linalg.norm(at.position)), 1e-9),
            float(np.exp(np.mean(np.log(squared)))),
            match,
            float(np.linalg.det(at.spread)) ** 0.25,
            cost=self.cost,
            motion=at.motion,
            known_motion=prior.start.known_motion,
            bend=bend,
            known_bend=prior.bend,
            shared=shared.factor,
            common=shared.common,
        )


class PhotoStepper:
    """Computes the steps of one target's fit.

    Args:
        projection: of the lens.
    """

    def __init__(self, projection: Projection) -> None:
        self._projection = projection

    def step(self, pixels: Grey, prints: Sequence[PrintModel], at: State, prior: Prior) -> PhotoStep | None:
        """One step; pose, spread and motion are those of all prints, each has its own light.

        None where no print is seen whole.
        """
        parts = [part for part in (self._part(pixels, model, at) for model in prints) if part is not None]
        if not parts:
            return None
        table = self._table(parts, at, prior, prints[0])
        residual, table = _without_lacking(_of_all([part.residual for part in parts]), table, at)
        unknowns = Unknowns(table)
        weighed = _weigh(residual, _of_all([part.at.value for part in parts]), LIMITS.certainty.deviations)
        weights = (weighed.share * weighed.clear) ** 2
        noise = max(weighed.squares / max(float(weights.sum()) - len(unknowns.rows), 1.0), LEAST_NOISE)
        least = LEAST_SHARED if at.motion is None else 0.0  # what a motion lacks hides under opposed noise
        steep, windows = _of_all([part.at.steep for part in parts]), [part.at.used for part in parts]
        noise *= shared_on_slopes(weighed.clipped, steep, windows, least)
        noise *= streak_doubt(at.spread)
        normal, right = unknowns.equations(weights, residual, noise)
        inverse = inverted(normal)
        to_go, covariance = (inverse @ right)[POSE], noise * inverse
        clearness = exp(2.0 * float(np.log(weighed.clear).sum()) / residual.size)
        comparable = weighed.squares / residual.size / clearness * (1.0 + unknowns.surprise / residual.size)
        found = unknowns, comparable, to_go, length2(to_go, covariance[POSE, POSE]), covariance
        return PhotoStep(*found, normal, right, parts, residual, weighed, least)

    def match(self, pixels: Grey, model: PrintModel, at: State) -> float:
        """Correlation between one print and the image where a state puts it; -1 where it cannot be told."""
        part = self._part(pixels, model, at)
        if part is None or part.brightness <= 0.0:
            return -1.0
        return correlation(part.at.grey, part.at.grey - part.residual)

    def _part(self, pixels: Grey, model: PrintModel, at: State) -> _Part | None:
        """What one print says; none where it is not in full view, or too few of its pixels are."""
        seen = model.samples(pixels, at.rotation, at.position, at.spread, at.motion)
        if seen is None:
            return None
        part = lit_print(seen)
        return part if part.at.grey.size >= LIMITS.photo.min_window_px**2 else None

    def _table(self, parts: Sequence[_Part], at: State, prior: Prior, first: PrintModel) -> list[Unknown]:
        """All unknowns of a step, the light last."""
        contrast = _of_all([part.contrast for part in parts])
        by_point = contrast * _of_all([part.at.by_point for part in parts])
        times = self._projection.row_times(_of_all([part.at.row for part in parts]))
        heights = None if first.sheet is None else first.sheet.heights(*(first.cell * parts[0].at.place))
        # Columns that lie together in memory are added and multiplied faster than rows of three.
        table = prior.table(at, by_point.T, _of_all([part.at.arm for part in parts]).T, times, heights)
        table.insert(2, Unknown("spread", contrast * _of_all([part.at.by_spread for part in parts])))
        light = parts[0].columns
        if len(parts) > 1:
            # Each print has light of its own.
            light, row, end = np.zeros((sum(len(part.gain) for part in parts), contrast.size)), 0, 0
            for part in parts:
                count, start, end = len(part.gain), end, end + part.at.grey.size
                light[row : row + count, start:end] = part.columns
                row += count
        return [*table, Unknown("light", light)]


def _of_all(rows: Sequence[Array]) -> Array:
    """What the pixels of all prints have `(n,)` or `(k, n)`, one print after the other."""
    return rows[0] if len(rows) == 1 else np.concatenate(rows, axis=-1)


def _without_lacking(residual: Array, table: Sequence[Unknown], at: State) -> tuple[Array, list[Unknown]]:
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
    anew = np.asarray(np.linalg.solve(*both.equations(weights, residual, scatter**2)), np.float64)
    # Of what the motion lacks the residual holds no more than is beside what was taken out.
    line["beyond"] = replace(line["beyond"], off=-anew[both["beyond"]])
    return residual - anew @ both.rows, list(line.values())
