"""One step of the fit to grey values: what the model says at each pixel, and where that moves pose, light and blur.

The light on a print is black, white, how these change over the print, and the tone curve of the camera. The noise of a
fit depends on brightness, and neighbouring pixels share it. Light, and what a motion lacks, are asked for anew at every
state, both at once: images are linear in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, sqrt
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array, Bools
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.pose.ambiguity import loss_of
from mkdaemon.vision.pose.edgefit import MAD
from mkdaemon.vision.pose.pose import Pose, correlation, damped, inverted, length2, median
from mkdaemon.vision.pose.prints import BOX, PrintSamples, principal
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
"""Variance of residuals on slopes, over that of all: it is 0.7-0.9 behind gamma 2.2, above 1 elsewhere."""
LEAST_SHARED = -0.5
"""The same where sharpening has set the noise of neighbours against each other: webcams have -0.2."""

STREAK_PX = 15.0
"""A streak so long doubles the variance of a fit; by the NEES of 819 smeared images (docs/lab/vision-fits.md)."""


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
    """What neighbours share of the residuals of a fit; over several prints the mean of their pixels.

    Demosaicing, denoising and what the model lacks are shared; the noise of a sensor is not. Where the correlation
    falls by r from a pixel to the next, the variance of a mean is (1 + r) / (1 - r) times that of independent pixels,
    each way; edges, which change over a few pixels, suffer less: (1 + r) / sqrt(1 - r), by the NEES of 80 images.
    Sharpening makes r < 0.

    Args:
        residual: of each used pixel of all windows, one window after the other `(n,)`.
        windows: which pixels of each are used, each `(rows, columns)`.
        least: correlation that is believed.

    Returns:
        The factor on the variance of a fit, less than 1 where neighbours contradict each other; and the share of the
        variance of a residual, not less than so many pixels can tell from none.
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
    """What one print says: the model of its grey values is I = gain . columns.

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
        """What a change of the print changes in the grey values `(n,)`."""
        white, _, _, _, second, third, toe = self.gain[:7].tolist()
        value = self.at.value
        polynomial = value * (6.0 * third * value - (2.0 * second + 6.0 * third)) + (white + second + third - toe)
        return np.asarray(polynomial + toe * TOE_GAIN / (TOE + np.maximum(value, 0.0)), np.float64)


def lit_print(at: PrintSamples) -> Part:
    """The light on a print, by least squares on its pixels without those that should be blown: these may be anything.

    What should be blown is told by the light on the other pixels, and left out whether it is or not: the others would
    be too dark by their noise. A blown pixel that should be dark stays, as a dark one that should be blown, and speaks
    against the pose. Where nothing is blown slopes are even: ground beside its shadow would look like a lit print.
    """
    tone, (u, v) = at.value * (1.0 - at.value), at.place
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
            clarity of mean logarithm zero: a cost by which two states compare, each with a clarity of its own.
        to_go: what of the pose would change without damping: how far it is from its place `(6,)`.
        length2: of that, in deviations of the pose's covariance, squared.
        covariance: of all unknowns `(k, k)`.
    """

    def __init__(self, parts: Sequence[Part], table: Sequence[Unknown], at: State) -> None:
        self._parts = parts
        self._residual, table = _without_lacking(of_all([part.residual for part in parts]), table, at)
        unknowns, count = Unknowns(table), self._residual.size
        clear = clarity(self._residual, of_all([part.at.value for part in parts]))
        shown = self._residual * clear
        self._size = np.maximum(np.abs(shown), 1e-6)
        self._share = np.minimum(LIMITS.certainty.deviations * max(MAD * median(self._size), 1.0) / self._size, 1.0)
        # Outliers are clipped to the largest residual of what is none.
        clipped = shown * self._share
        squares = float(clipped @ clipped)
        weights = (self._share * clear) ** 2
        noise = max(squares / max(float(weights.sum()) - len(unknowns.rows), 1.0), LEAST_NOISE)
        weighed, larger = on_slopes(clipped, of_all([part.at.steep for part in parts]))
        least = LEAST_SHARED if at.motion is None else 0.0  # what a motion lacks hides under opposed noise
        self._shared, self._common = shared_by(weighed, [part.at.used for part in parts], least)
        noise *= larger * self._shared * streak_doubt(at.spread)
        self._normal, self._right = unknowns.equations(weights, self._residual, noise)
        inverse = inverted(self._normal)
        self.unknowns, self.covariance = unknowns, noise * inverse
        self.to_go = (inverse @ self._right)[POSE]
        self.length2 = length2(self.to_go, self.covariance[POSE, POSE])
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
        # Residual as a shift of edges: rms over the rms slope of the lit prints [grey / (grey/px)].
        steepness = sqrt(sum(float(p.at.steep.sum()) * float(p.gain[0]) ** 2 for p in self._parts) / self._size.size)
        covariance, bend = prior.measured(at, self.unknowns, self.covariance)
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
            match,
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
    """Correlation of an image with what it shows of prints, less residuals `(n,)`; -1 for none or a negative."""
    if not parts or not all(part.gain[0] > 0.0 for part in parts):
        return -1.0
    grey = of_all([part.at.grey for part in parts])
    return correlation(grey, grey - residual)


def of_all(rows: Sequence[Array]) -> Array:
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
