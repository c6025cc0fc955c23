"""One step of the fit to grey values: what the model says at each pixel, and where that moves pose, light and blur."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import Limits
from mkdaemon.vision.pose.bend import RISES, Bend
from mkdaemon.vision.pose.edgefit import Level
from mkdaemon.vision.pose.edgestep import MAD, damped
from mkdaemon.vision.pose.greynoise import LEAST_SHARED, clarity, shared_by_all, shared_on_slopes, streak_doubt
from mkdaemon.vision.pose.nuisance import BEYOND, beyond_motion, beyond_sd, motion_known
from mkdaemon.vision.pose.photobeside import asked_anew
from mkdaemon.vision.pose.pose import Pose, correlation, median
from mkdaemon.vision.pose.printimage import PrintSamples
from mkdaemon.vision.pose.printlight import LIGHTS, Lit, lit_print
from mkdaemon.vision.pose.printmodel import PrintModel
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import MOTIONS, at_rest, at_times, before_motion, cross, motion_jacobian

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

COST_BOUND: Final = 5.0
"""Deviations at which a residual costs no more."""
LEAST_NOISE: Final = 0.3
"""Variance of grey values rounded to integers and averaged by the fit [grey^2]."""
POSE, LIGHT, SPREAD, MOTION, BENDS = slice(0, 6), slice(6, 16), slice(16, 19), slice(19, 23), slice(23, 28)
"""Where the unknowns are: pose, then light with its tone curve, point spread; under a rolling shutter the motion and
what it lacks. Behind all of them comes the bend of an only print, or the light of further prints."""
SPREADS: Final = 3
LIGHT_UNIT: Final = 100.0
"""Unknowns are solved for in units in which they are of one size [grey]."""


@dataclass(frozen=True, slots=True, eq=False)
class PhotoState:
    """Where a fit is.

    Attributes:
        rotation: camera from target `(3, 3)`.
        position: of the target `(3,)` [m; RDF].
        spread: covariance of the point spread `(2, 2)` [px^2].
        motion: under a rolling shutter `(4,)`; none under a global one.
        rise: of the print `(3,)`; none where it does not bend.
    """

    rotation: Array
    position: Array
    spread: Array
    motion: Array | None
    rise: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PhotoStep:
    """One Gauss-Newton step.

    Attributes:
        change: of all unknowns: position [m], rotation vector [rad], light, point spread [px^2], motion.
        cost: robust mean square of the residuals before the step [grey^2], with what prior knowledge adds.
        pose: the pose the step starts from, with its covariance.
        to_go: that of the pose without damping: how far it is from its place `(6,)`.
        length2: of that, in deviations of the pose's covariance, squared.
    """

    change: Array
    cost: float
    pose: Pose
    to_go: Array
    length2: float


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """What one print says.

    Attributes:
        at: model and image at its pixels.
        residual: of each pixel `(n,)` [grey].
        rows: derivative by all unknowns of a single print `(k, n)`, in units of one size.
        unit: these units `(k,)`.
        brightness: of its white over its black [grey].
        steepness: rms slope of the lit print [grey/px].
    """

    at: PrintSamples
    residual: Array
    rows: Array
    unit: Array
    brightness: float
    steepness: float


class PhotoStepper:
    """Computes the steps of one target's fit.

    Args:
        projection: of the lens.
        limits: all thresholds.
    """

    def __init__(self, projection: Projection, limits: Limits) -> None:
        self._projection, self._limits = projection, limits
        self._line_time = projection.intrinsics.line_time

    def step(
        self,
        pixels: Grey,
        prints: Sequence[PrintModel],
        state: PhotoState,
        start: Pose,
        level: Level | None,
        damping: float,
    ) -> PhotoStep | None:
        """One step: (J W J^T + P + damping diag) s = J W r + p with what is known beforehand, P and p.

        Pose, spread and motion are those of all prints, each has its own light. None where no print is seen whole.
        """
        parts = [part for part in (self._part(pixels, model, state) for model in prints) if part is not None]
        if not parts:
            return None
        limits, rotation, position = self._limits.photo, state.rotation, state.position
        jacobian, unit = _joined(parts)
        value = np.concatenate([part.at.value for part in parts])
        grey = np.concatenate([part.at.grey for part in parts])
        residual = np.concatenate([part.residual for part in parts])
        rises = slice(len(unit) - RISES if state.rise is not None else len(unit), len(unit))
        if state.rise is not None:
            # The print is rendered flat; its bend moves what is seen by less than a pixel.
            residual -= state.rise @ jacobian[rises]
        bends = np.zeros(0)
        if state.motion is not None:
            rows = jacobian[np.r_[BENDS, LIGHT, BENDS.stop : rises.start]]
            spread = np.concatenate([beyond_sd(self._limits.edges), np.full(len(rows) - BEYOND, np.inf)])
            anew = asked_anew(residual, rows, spread, limits.outlier)
            residual -= anew @ rows
            bends = anew[:BEYOND]
        # Robust weights: 1 within c sigma, (c sigma / r)^2 beyond, sigma from the median of |r|; times the clarity.
        clear = clarity(residual, value)
        size = np.maximum(np.abs(residual) * clear, 1e-6)
        scatter = max(MAD * median(size), 1.0)
        bound = limits.outlier * scatter
        agreeing = np.where(size < bound, 1.0, (bound / size) ** 2)
        weights = agreeing * clear**2
        cost = float(np.mean(np.minimum(size, COST_BOUND * scatter) ** 2))
        weighted = jacobian * weights
        noise = max(float((weights * residual**2).sum() / max(weights.sum() - len(unit), 1.0)), LEAST_NOISE)
        least = LEAST_SHARED if state.motion is None else 0.0  # what a motion lacks hides under opposed noise
        clipped, windows = np.clip(residual * clear, -bound, bound), [part.at.used for part in parts]
        shared = shared_by_all(clipped, windows, least)
        steeper = shared_on_slopes(clipped, np.concatenate([part.at.steep for part in parts]), windows, least)
        noise *= steeper * streak_doubt(state.spread)
        prior, pull, surprise = self._prior(state, bends, start, level, noise, len(unit))
        sheet = prints[0].sheet
        if sheet is not None and state.rise is not None:
            known = start.known_bend or sheet.prior
            off, information = known.mean - state.rise, known.information
            prior[rises, rises], pull[rises] = noise * information, noise * information @ off
            surprise += float(off @ information @ off)
        normal = damped(weighted @ jacobian.T + prior * np.outer(unit, unit))
        ridge = damping * np.diag(np.diag(normal))
        right = weighted @ residual + pull * unit
        change = np.linalg.solve(normal + ridge, right) * unit
        # Covariance of the pose with the rest unknown: sigma^2 times its block of the inverse normal matrix.
        inverse = np.linalg.inv(normal) * np.outer(unit, unit)
        to_go = (inverse @ (right / unit))[POSE]
        inverse = noise * inverse
        covariance = (inverse[POSE, POSE] + inverse[POSE, POSE].T) / 2
        bend = None
        if sheet is not None and state.rise is not None:
            bend = Bend(state.rise + change[rises], inverse[rises, rises])
            covariance[:3, :3] += sheet.plane_covariance(rotation, bend)
        # Residual as a shift of edges: rms over the rms slope of the lit prints [grey / (grey/px)].
        steepness = sqrt(sum(part.steepness**2 * part.residual.size for part in parts) / value.size)
        # Clarity of mean logarithm zero: a cost by which two states compare, each with a clarity of its own.
        comparable = cost * float(np.exp(-2.0 * np.mean(np.log(clear)))) * (1.0 + surprise / value.size)
        squared = np.minimum(size, limits.lost_grey) ** 2 + limits.quiet_grey**2
        is_positive = all(part.brightness > 0.0 for part in parts)
        pose = Pose(
            rotation,
            position,
            covariance,
            "photometric",
            int((agreeing > limits.counted).sum()),
            float(np.sqrt(cost)) / max(steepness, 1e-3) if is_positive else np.inf,
            float((agreeing > limits.counted).mean()),
            float(np.linalg.norm(change[:3])) / max(float(np.linalg.norm(position)), 1e-9),
            float(np.exp(np.mean(np.log(squared)))),
            correlation(grey, grey - residual) if is_positive else -1.0,
            float(np.linalg.det(state.spread)) ** 0.25,
            cost=comparable,
            motion=state.motion,
            known_motion=start.known_motion,
            bend=bend,
            known_bend=start.known_bend,
            shared=shared.factor,
            common=shared.common,
        )
        return PhotoStep(change, comparable, pose, to_go, float(to_go @ np.linalg.solve(pose.covariance, to_go)))

    def match(self, pixels: Grey, model: PrintModel, state: PhotoState) -> float:
        """Correlation between one print and the image where a state puts it; -1 where it cannot be told."""
        part = self._part(pixels, model, state)
        if part is None or part.brightness <= 0.0:
            return -1.0
        return correlation(part.at.grey, part.at.grey - part.residual)

    def _part(self, pixels: Grey, model: PrintModel, state: PhotoState) -> _Part | None:
        """What one print says; none where it is not in full view, or too few of its pixels are."""
        rendered = model.render(pixels.shape, state.rotation, state.position, state.spread, state.motion)
        if rendered is None:
            return None
        at, lit = lit_print(rendered.samples(pixels), model.half, self._limits.read)
        if at.value.size < self._limits.photo.min_window_px**2:
            return None
        rows, unit = self._jacobian(at, lit, model, state)
        steepness = float(np.sqrt(np.mean(at.steep))) * abs(float(lit.gain[0]))
        return _Part(at, at.grey - lit.gain @ lit.columns, rows, unit, float(lit.gain[0]), steepness)

    def _jacobian(self, at: PrintSamples, lit: Lit, model: PrintModel, state: PhotoState) -> tuple[Array, Array]:
        """Derivative of a print's grey values by all its unknowns `(k, n)`, in units `(k,)` of one size."""
        rotation, axes, motion = state.rotation, model.axes, state.motion
        # Columns that lie together in memory are added and multiplied faster than rows of three.
        place = np.stack([at.u, at.v])
        arm = (rotation @ axes[:, :2] @ place + (rotation @ model.origin)[:, None]).T
        seen, times = arm + state.position, np.zeros(len(arm))
        if motion is not None:
            times = (at.row - (self._projection.intrinsics.height - 1) / 2) * self._line_time
            seen = at_times(seen, motion, times)
        point = self._projection.jacobian(seen)
        along = np.stack([at.dx, at.dy]).T
        if motion is not None:
            along = at_rest(along, point, seen, motion, self._line_time)
        # Pose: a print that moves by d shows at a pixel what was d before it, dI = -dI/dm grad(m) . du; a turn w moves
        # a point at `arm` by w x arm.
        slope = -lit.contrast[:, None] * (along[:, :1] * point[:, 0] + along[:, 1:] * point[:, 1])
        moved = slope if motion is None else before_motion(slope, motion, times)
        # Blur: a Gaussian obeys the heat equation, dm/dB = (m_xx, 2 m_xy, m_yy) / 2.
        blur = lit.contrast * np.stack([0.5 * at.dxx, at.dxy, 0.5 * at.dyy])
        rows = [moved.T, cross(arm, moved).T, lit.columns, blur]
        units = [np.full(3, state.position[2]), np.ones(3), np.full(LIGHTS, LIGHT_UNIT), np.ones(SPREADS)]
        if motion is not None:
            by_motion = motion_jacobian(slope, arm + state.position, times)
            rows += [by_motion.T, beyond_motion(by_motion, moved, times, state.position).T]
            units.append(np.ones(MOTIONS + BEYOND))
        if model.sheet is not None:
            rows.append((moved @ (rotation @ model.sheet.normal)) * model.sheet.heights_at(*place))
            units.append(np.ones(RISES))
        unit = np.concatenate(units)
        jacobian = np.concatenate(rows)
        jacobian *= unit[:, None]
        return jacobian, unit

    def _prior(
        self, state: PhotoState, bends: Array, start: Pose, level: Level | None, noise: float, count: int
    ) -> tuple[Array, Array, float]:
        """What is known beside the image: normal matrix, right side, and the squared distance of the state from it."""
        prior, pull, surprise = np.zeros((count, count)), np.zeros(count), 0.0
        if level is not None:
            prior[POSE, POSE], pull[POSE] = level.pull(state.rotation, noise**0.5)
            tilt = np.cross(state.rotation[:, 2], level.up)
            surprise += float(tilt @ tilt) / level.spread**2
        if state.motion is not None:
            expected, spread = motion_known(start, self._limits.edges)
            # Of what the motion lacks the residual holds no more than is beside `bends`.
            spread = np.concatenate([spread, beyond_sd(self._limits.edges)])
            off = np.concatenate([expected - state.motion, -bends])
            unknown = slice(MOTION.start, BENDS.stop)
            weight = noise / spread**2
            prior[unknown, unknown] = np.diag(weight)
            pull[unknown] = weight * off
            surprise += float(((off / spread) ** 2).sum())
        return prior, pull, surprise


def _joined(parts: Sequence[_Part]) -> tuple[Array, Array]:
    """Derivatives of all prints' grey values `(k, n)` with their units `(k,)`."""
    first, *others = parts
    if not others:
        return first.rows, first.unit
    rows = np.concatenate([part.rows for part in parts], axis=1)
    lights = np.zeros((LIGHTS * len(others), rows.shape[1]))
    end = first.rows.shape[1]
    rows[LIGHT, end:] = 0.0
    for number, part in enumerate(others):
        start, end = end, end + part.rows.shape[1]
        lights[LIGHTS * number : LIGHTS * (number + 1), start:end] = part.rows[LIGHT]
    return np.concatenate([rows, lights]), np.concatenate([first.unit, np.tile(first.unit[LIGHT], len(others))])
