"""Pose refinement on every pixel of a small tag.

Below four pixels a cell edges melt into each other and a located edge means little. Here the known print is rendered
through pose, pixel area and point spread, and pose x, light a and blur b are fitted to the grey values at once:

    I(p) = a0 m(p; x, b) + a1 + a2 u(p) + a3 v(p) + a4 m (1 - m)

with m the rendered print, 0 to 1, and (u, v) the place of the pixel p in the print; a4 is the camera's tone curve to
second order, which leaves black and white as they are.

Source: direct alignment, Lucas and Kanade, IJCAI 1981; Gauss-Newton with Levenberg damping.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.limits import LIMITS, Limits
from mkdaemon.vision.pose.pose import Pose, correlation, median, turn
from mkdaemon.vision.pose.printmodel import PrintModel, RenderedPrint
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.tags.tagmap import Target

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

START_BLUR_PX = 0.7
BLUR_PX = (0.35, 5.0)
"""Point spread that is modelled, deviation [px]."""
MAX_BLUR_STEP = 0.3
"""Most its logarithm changes in one step."""
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-7, 1e-2
"""Levenberg's share of the diagonal: at first, at least, and the last from which a worse step is tried again."""
EASE, TIGHTEN = 0.3, 30.0
"""Factors on the damping after a better and a worse step."""
SAME_COST = 3e-4
"""A step that lowers the cost by a smaller share ends the fit."""
WORSE_COST = 1.001
"""A step whose cost rises by less is no worse: the fit has settled."""
SETTLED_RAD, SETTLED_SHARE, SETTLED_BLUR = 5e-5, 2e-5, 0.01
"""A step below all of these ends the fit: turn [rad], move over the depth, logarithm of the blur."""
MAD = 1.4826
"""Deviation of Gaussian residuals over their median absolute value."""
COST_BOUND = 5.0
"""Deviations at which a residual costs no more."""
LEAST_NOISE = 0.3
"""Variance of grey values rounded to integers and averaged by the fit [grey^2]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """One Gauss-Newton step.

    Attributes:
        turn_and_move: of the pose `(6,)`, position [m] then rotation vector [rad].
        blur: of the logarithm of the point spread.
        cost: robust mean square of the residuals before the step [grey^2].
        pose: the pose the step starts from, with its covariance.
    """

    turn_and_move: Array
    blur: float
    cost: float
    pose: Pose


class PhotoFit:
    """Fits the pose of one target to grey values; uses the tags in the plane of the largest one."""

    def __init__(self, target: Target, projection: Projection, limits: Limits = LIMITS) -> None:
        self._projection = projection
        self._limits = limits
        self._print = PrintModel(target, projection, limits)

    def fit(self, pixels: Grey, start: Pose, iterations: int = 8) -> Pose | None:
        """Refine a pose.

        Args:
            pixels: `(h, w)` uint8.
            start: within about a cell of the truth.
            iterations: steps at most; converged fits stop earlier.

        Returns:
            The pose, `rms_px` being the residual over the contrast; none when the print is not in full view, too large
            for this method, or does not resemble the image.
        """
        rotation, position = start.rotation, start.position
        blur, damping, last = START_BLUR_PX, FIRST_DAMPING, np.inf
        best: tuple[Array, Array, float] | None = None
        fitted: Pose | None = None
        for _ in range(iterations):
            model = self._print.render(pixels.shape, rotation, position, blur)
            if model is None:
                return None
            step = self._step(pixels, model, rotation, position, damping)
            if step is None:
                return None
            if step.cost < last:
                settled = last - step.cost < SAME_COST * step.cost
                best, last, fitted = (rotation, position, blur), step.cost, step.pose
                if settled:
                    break
                damping = max(damping * EASE, LEAST_DAMPING)
            else:
                if best is None or damping > MOST_DAMPING or step.cost < last * WORSE_COST:
                    break
                rotation, position, blur = best
                damping *= TIGHTEN
                model = self._print.render(pixels.shape, rotation, position, blur)
                if model is None:
                    return None
                step = self._step(pixels, model, rotation, position, damping)
                if step is None:
                    return None
            move, turned = step.turn_and_move[:3], step.turn_and_move[3:]
            small = float(np.abs(turned).max()) < SETTLED_RAD
            small = small and float(np.linalg.norm(move)) < SETTLED_SHARE * position[2]
            if small and abs(step.blur) < SETTLED_BLUR:
                break
            rotation, position = turn(rotation, turned), position + move
            blur = float(np.clip(blur * np.exp(np.clip(step.blur, -MAX_BLUR_STEP, MAX_BLUR_STEP)), *BLUR_PX))
            if not np.isfinite(position).all() or position[2] < NEAR_M:
                return None
            if np.linalg.norm(position - start.position) > self._limits.edges.max_move * start.range_m:
                return None
        return fitted

    def polish(self, pixels: Grey, pose: Pose) -> Pose:
        """Measure a pose from edges once more by the grey values, where these know more and do not object.

        Cells of five to ten pixels have sharp edges and still few of them: the pixels between tell as much again. The
        edges stay the evidence that gates and rivals are judged by; only place and covariance are taken over.

        Args:
            pixels: `(h, w)` uint8.
            pose: fitted to edges, whole target in view.

        Returns:
            The better pose, or `pose` itself.
        """
        limits, whole = self._limits, self._limits.agreement.whole
        cell_px = float(self._projection.focal[0]) * self._print.cell / max(float(pose.position[2]), NEAR_M)
        if pose.source != "edges" or cell_px > limits.cells.small_px or pose.inliers < whole:
            return pose
        grey = self.fit(pixels, pose)
        if grey is None or grey.match is None or grey.match < limits.photo.polish_match or grey.inliers < whole:
            return pose
        if float(np.linalg.det(grey.covariance)) >= float(np.linalg.det(pose.covariance)):
            return pose
        turned = np.asarray(cv2.Rodrigues(grey.rotation @ pose.rotation.T)[0], dtype=np.float64).ravel()
        apart = np.concatenate([grey.position - pose.position, turned])
        if float(apart @ np.linalg.solve(pose.covariance, apart)) > limits.photo.same_mahalanobis2:
            return pose
        return replace(pose, rotation=grey.rotation, position=grey.position, covariance=grey.covariance)

    def _step(
        self, pixels: Grey, model: RenderedPrint, rotation: Array, position: Array, damping: float
    ) -> _Step | None:
        """One step from a pose: (J W J^T + damping diag) s = J W r, unknowns pose, light and log of the blur.

        None where the image holds fewer pixels of the print than the smallest print has.
        """
        limits, axes, half = self._limits.photo, self._print.axes, self._print.half
        at = model.samples(pixels)
        if at.value.size < limits.min_window_px**2:
            return None
        arm = np.column_stack([at.u, at.v]) @ (rotation @ axes[:, :2]).T + rotation @ self._print.origin
        point = self._projection.jacobian(arm + position)
        # Light: least squares of I = a . (m, 1, u, v) at the present pose and blur; residual r = I - a . (m, 1, u, v).
        tone = at.value * (1.0 - at.value)
        light = np.stack([at.value, np.ones_like(at.value), at.u / half, at.v / half, tone])
        gain: Array = np.asarray(np.linalg.solve(light @ light.T + 1e-6 * np.eye(5), light @ at.grey), dtype=np.float64)
        lit: Array = np.asarray(gain @ light, dtype=np.float64)
        residual = at.grey - lit
        # Robust weights: 1 within c sigma, (c sigma / r)^2 beyond, sigma from the median of |r|.
        size = np.abs(residual)
        spread = max(MAD * median(size), 1.0)
        np.maximum(size, 1e-6, out=size)
        bound = limits.outlier * spread
        weights = np.where(size < bound, 1.0, (bound / size) ** 2)
        cost = float(np.mean(np.minimum(size, COST_BOUND * spread) ** 2))
        # Pose: a print that moves by d shows at a pixel what was d before it, dI = -dI/dm grad(m) . du; a turn w moves
        # a point at `arm` by w x arm.
        jacobian = np.empty((12, len(at.value)))
        contrast = gain[0] + gain[4] * (1.0 - 2.0 * at.value)
        slope = (at.dx * -contrast)[:, None] * point[:, 0] + (at.dy * -contrast)[:, None] * point[:, 1]
        jacobian[:3] = slope.T
        jacobian[3] = arm[:, 1] * slope[:, 2] - arm[:, 2] * slope[:, 1]
        jacobian[4] = arm[:, 2] * slope[:, 0] - arm[:, 0] * slope[:, 2]
        jacobian[5] = arm[:, 0] * slope[:, 1] - arm[:, 1] * slope[:, 0]
        jacobian[6:11] = light
        # Blur: a Gaussian obeys the heat equation, dm/db = b laplace(m), so dI/d(log b) = dI/dm b^2 laplace(m).
        jacobian[11] = at.laplace * contrast * model.blur**2
        # Unknowns in units in which they are of one size, or the normal matrix loses its digits.
        unit = np.concatenate([np.full(3, position[2]), np.ones(3), np.full(5, 100.0), [1.0]])
        jacobian *= unit[:, None]
        weighted = jacobian * weights
        normal = weighted @ jacobian.T
        ridge = damping * np.diag(np.diag(normal)) + 1e-9 * np.eye(len(unit))
        solved = np.linalg.solve(normal + ridge, weighted @ residual) * unit
        # Covariance of the pose with light and blur unknown: sigma^2 times its block of the inverse normal matrix.
        inverse = np.linalg.inv(normal + 1e-9 * np.eye(len(unit)))[:6, :6] * np.outer(unit[:6], unit[:6])
        noise = float((weights * residual**2).sum() / max(weights.sum() - 12.0, 1.0))
        # Residual as a shift of edges: rms over the rms slope of the lit print [grey / (grey/px)].
        steepness = float(np.sqrt(np.mean(at.dx**2 + at.dy**2))) * abs(float(gain[0]))
        squared = np.minimum(size, limits.lost_grey) ** 2 + limits.quiet_grey**2
        pose = Pose(
            rotation,
            position,
            limits.variance_factor * max(noise, LEAST_NOISE) * (inverse + inverse.T) / 2,
            "photometric",
            int((weights > limits.counted).sum()),
            float(np.sqrt(cost)) / max(steepness, 1e-3) if gain[0] > 0 else np.inf,
            float((weights > limits.counted).mean()),
            float(np.linalg.norm(solved[:3])) / max(float(np.linalg.norm(position)), 1e-9),
            float(np.exp(np.mean(np.log(squared)))),
            correlation(at.grey, lit) if gain[0] > 0 else -1.0,
            model.blur,
        )
        return _Step(solved[:6], float(solved[11]), cost, pose)
