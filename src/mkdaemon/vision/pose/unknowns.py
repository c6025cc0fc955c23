"""The unknowns of a fit: what is known of them before an image, how a step is solved for them, and where a fit is.

All stand in one table. With its rows J, the derivative of what is measured, residuals d of variance v and weight W, the
information P that is known beforehand and e, what is expected less where the fit is, a step is

    x = (J W J^T + v P)^-1 (J W d + v P e)

and v times that inverse the covariance of all unknowns. Errors that no fit asks for, with rows K and the covariance Q,
move it by S = (J W J^T + v P)^-1 J W K^T and add S Q S^T. Source: consider analysis, Bierman, Factorization Methods for
Discrete Sequential Estimation, Academic Press 1977, chapter VIII.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array, UnknownsEstimate
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.pose import Pose, damped, turn
from mkdaemon.vision.pose.prints import Sheet
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.pose.rolling import MOTIONS, Shutter, beyond_motion, cross, motion_jacobian, skew

POSE: Final = slice(0, 6)
"""Where the pose is among the unknowns, position before rotation: first."""
ANY_MOTION: Final = UnknownsEstimate(
    np.zeros(MOTIONS), np.diag([LIMITS.edges.turning_sd] * 3 + [LIMITS.edges.speed_sd]) ** 2
)
"""Prior of an unknown motion."""
BEYOND_SD: Final = np.array([LIMITS.edges.acceleration_sd] * 3 + [LIMITS.edges.speed_sd] * 2)
"""Deviations of what a motion lacks: three angular accelerations [rad/s^2], two speeds [m/s]."""
RIDGE: Final = 1e-6
"""Information about a motion that no image shows [s^2/rad^2]."""
SETTLED: Final = 0.3
"""A fit has arrived from where a step is shorter: squared length in deviations of the fit."""
CARRIED: Final = ("place", "turn", "rise", "motion", "spread")
"""Unknowns that a state carries from step to step; each step asks for all of the others."""


@dataclass(frozen=True, slots=True, eq=False)
class UnknownRow:
    """One line of the table.

    Attributes:
        name: of these unknowns.
        rows: derivative of what is measured by each `(k, n)`.
        information: inverse covariance of what is expected `(k, k)`, or its diagonal `(k,)`; zero where nothing is.
        off: what is expected, less where the fit is `(k,)`.
        is_asked: whether a step is solved for them; others only make it less certain.
    """

    name: str
    rows: Array
    information: Array = field(default_factory=lambda: np.zeros(1))
    off: Array = field(default_factory=lambda: np.zeros(1))
    is_asked: bool = True


class Unknowns:
    """The unknowns of one step.

    Args:
        table: of them, the pose first, those that are carried before those that are not.

    Attributes:
        rows: derivative of what is measured `(k, n)`.
        carried: how many of them a state carries from step to step, the first ones.
        information: that is known beforehand `(k, k)`.
        surprise: squared distance of the fit from what is expected, in deviations of that.
    """

    def __init__(self, table: Sequence[UnknownRow]) -> None:
        self._beside = [line for line in table if not line.is_asked]
        table = [line for line in table if line.is_asked]
        self.rows = np.concatenate([line.rows for line in table])
        count, stop = len(self.rows), 0
        self.carried = 0
        self.information, off = np.zeros((count, count)), np.zeros(count)
        self._blocks: dict[str, slice] = {}
        for line in table:
            start, stop = stop, stop + len(line.rows)
            block = self._blocks[line.name] = slice(start, stop)
            if line.name in CARRIED:
                self.carried = stop
            known = line.information
            self.information[block, block] = known if known.ndim > 1 else np.diag(known)
            off[block] = line.off
        self._pull = self.information @ off
        self.surprise = float(off @ self._pull)

    def __contains__(self, name: str) -> bool:
        return name in self._blocks

    def __getitem__(self, name: str) -> slice:
        return self._blocks[name]

    def equations(self, weights: Array, measured: Array, variance: float) -> tuple[Array, Array]:
        """Normal matrix `(k, k)` and right side `(k,)` of a step.

        Args:
            weights: of the residuals `(n,)`.
            measured: the residuals `(n,)`.
            variance: of one with the weight 1.
        """
        weighted = self.rows * weights
        normal = weighted @ self.rows.T + variance * self.information
        return damped(normal), weighted @ measured + variance * self._pull

    def covariance(self, inverse: Array, weights: Array, variance: float) -> Array:
        """Of all unknowns `(k, k)`, by the inverse of the normal matrix; see `equations`."""
        covariance = variance * inverse
        for line in self._beside:
            moved = inverse @ (self.rows * weights) @ line.rows.T
            covariance += moved / line.information @ moved.T
        return covariance


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """State of a fit.

    Attributes:
        rotation: camera from target `(3, 3)`.
        position: of the target `(3,)` [m; RDF].
        spread: covariance of the point spread `(2, 2)` [px^2]; fits to edges ask for none.
        motion: of the camera under a rolling shutter `(4,)`; none under a global one. See `rolling`.
        rise: of the print `(3,)`; none where it does not bend.
    """

    rotation: Array
    position: Array
    spread: Array
    motion: Array | None = None
    rise: Array | None = None

    def moved(self, unknowns: Unknowns, change: Array) -> State:
        """After a step `(k,)`; the point spread, which has bounds, is moved by its fit."""
        added = {name: getattr(self, name) + change[unknowns[name]] for name in ("motion", "rise") if name in unknowns}
        rotation = turn(self.rotation, change[unknowns["turn"]])
        return replace(self, rotation=rotation, position=self.position + change[unknowns["place"]], **added)

    def ran_away(self, start: Pose) -> bool:
        """Whether it left what a camera sees, or the neighbourhood of where it began."""
        if not np.isfinite(self.position).all() or self.position[2] < NEAR_M:
            return True
        return float(np.linalg.norm(self.position - start.position)) > LIMITS.edges.max_move * start.range_m


@dataclass(frozen=True, slots=True, eq=False)
class TargetLevel:
    """Prior of the direction of a target's normal.

    Attributes:
        up: vertical `(3,)` [camera].
        spread: standard deviation, each axis [rad].
    """

    up: Array
    spread: float


class Prior:
    """Prior of the unknowns that all fits have.

    Args:
        start: of the fit; may know motion and bend.
        level: where the target's normal should point, if anywhere.
        projection: of the camera.
        sheet: that the print is on; none where it does not bend.

    Attributes:
        start: see above.
        bend: what is known of that; none where the print does not bend.
    """

    def __init__(self, start: Pose, level: TargetLevel | None, projection: Projection, sheet: Sheet | None) -> None:
        self.start = start
        self._level, self._projection, self._sheet = level, projection, sheet
        self._motion: UnknownsEstimate | None = None
        shutter = projection.shutter
        if shutter.rolls:
            self._motion = motion_before(start, shutter)
            # Times the line time over the nominal one; of an acceleration twice.
            self._beyond_sd = BEYOND_SD * shutter.scale ** np.array([2, 2, 2, 1, 1])
        self.bend: UnknownsEstimate | None = None if sheet is None else start.known_bend or sheet.prior

    def begin(self, blur_px: float = 0.0) -> State:
        """Start of the fit, with a round point spread of some deviation."""
        at_start = np.zeros(MOTIONS) if self.start.motion is None else self.start.motion
        motion = None if self._motion is None else at_start
        rise = None if self.bend is None else (self.start.bend or self.bend).mean
        return State(self.start.rotation, self.start.position, blur_px**2 * np.eye(2), motion, rise)

    def table(
        self, at: State, by_point: Array, arm: Array, times: Array, heights: Array | None, error_px: float = 0.0
    ) -> list[UnknownRow]:
        """The unknowns that all fits have, of what is measured at points of the print.

        A turn w moves a point at `arm` by w x arm, so that its derivative is arm x that by the point.

        Args:
            at: where the fit is.
            by_point: derivative of what is measured by the points `(n, 3)`.
            arm: from the target's origin to the points at rest `(n, 3)` [m; camera].
            times: when they are exposed `(n,)` [s].
            heights: of the points by the rise of the print `(3, n)` [m]; none where that is not asked for.
            error_px: of a length in the image that no number of measurements averages out [px].
        """
        turning = UnknownRow("turn", cross(arm, by_point).T)
        if self._level is not None:
            # The turn that levels a normal n is n x up; about n it is free.
            normal = at.rotation[:, 2]
            known = (np.eye(3) - np.outer(normal, normal)) / self._level.spread**2
            turning = replace(turning, information=known, off=skew(normal) @ self._level.up)
        table = [UnknownRow("place", by_point.T), turning]
        if heights is not None and self._sheet is not None and self.bend is not None and at.rise is not None:
            along = by_point @ (at.rotation @ self._sheet.normal)
            table.append(UnknownRow("rise", along * heights, self.bend.information, self.bend.mean - at.rise))
        if at.motion is not None and self._motion is not None:
            rows = motion_jacobian(by_point, arm + at.position, times)
            lacking = beyond_motion(rows, by_point, times, at.position)
            table.append(UnknownRow("motion", rows, self._motion.information, self._motion.mean - at.motion))
            table.append(UnknownRow("beyond", lacking, self._beyond_sd**-2))
        variance = self._projection.aspect_sd**2
        if error_px > 0.0:
            far = sqrt(float((arm[:, :2] ** 2).sum(axis=1).max())) / float(at.position[2])
            variance += (error_px / (float(self._projection.focal[0]) * far)) ** 2
        return [*table, self._aspect(by_point, arm, variance)] if variance > 0.0 else table

    def _aspect(self, by_point: Array, arm: Array, variance: float) -> UnknownRow:
        """By which share an image is longer along its rows than its columns, and along one diagonal than the other.

        In a frontal view, a tilt t shortens one axis by the share 1 - cos t = t^2 / 2, so an error s of the aspect
        causes an error s / t of the tilt. The self-calibration estimates it if the calibration's aspect is uncertain;
        it does not estimate errors that no number of measurements averages out.
        """
        (across, down, _), (x, y, _) = by_point.T, arm.T
        rows = HALF * np.array([across * x - down * y, across * y + down * x])
        return UnknownRow("aspect", rows, np.full(len(rows), 1.0 / variance), is_asked=self._projection.aspect_sd > 0.0)

    def measured(self, at: State, unknowns: Unknowns, covariance: Array) -> tuple[Array, UnknownsEstimate | None]:
        """Covariance of the pose `(6, 6)`, and what was found of the bend, by that of all unknowns `(k, k)`."""
        pose = (covariance[POSE, POSE] + covariance[POSE, POSE].T) / 2
        if self._sheet is None or at.rise is None or "rise" not in unknowns:
            return pose, None
        bend = UnknownsEstimate(at.rise, covariance[unknowns["rise"], unknowns["rise"]])
        pose[:3, :3] += self._sheet.plane_covariance(at.rotation, bend)
        return pose, bend

    def seen_motion(self, at: State, unknowns: Unknowns, covariance: Array) -> UnknownsEstimate | None:
        """Motion by the image alone, if it determines a line time; see `measured`.

        The prior of the fit, W and m0, is taken out of its result, C and m: C^-1 - W, and C^-1 m - W m0.
        """
        if at.motion is None or self._motion is None or not self._projection.shutter.is_open:
            return None
        found = np.linalg.inv(covariance[unknowns["motion"], unknowns["motion"]])
        given = self._motion.information
        values, axes = np.linalg.eigh(found - given)
        own = axes / (np.maximum(values, 0.0) + RIDGE) @ axes.T
        return UnknownsEstimate(own @ (found @ at.motion - given @ self._motion.mean), own)


def motion_before(pose: Pose, shutter: Shutter) -> UnknownsEstimate:
    """Prior of the motion of a pose."""
    return shutter.motion(pose.known_motion or ANY_MOTION)


def motion_cost(pose: Pose, shutter: Shutter) -> float:
    """Cost of a fitted motion by its prior [nats]."""
    if pose.motion is None:
        return 0.0
    known = motion_before(pose, shutter)
    surprise = pose.motion - known.mean
    return HALF * float(surprise @ known.information @ surprise)


def not_arrived(pose: Pose, to_go: Array) -> Pose:
    """The pose of a fit that would go on by a step `(6,)`: that is an error, too."""
    return replace(pose, covariance=pose.covariance + np.outer(to_go, to_go))
