"""How a reference lies against a camera: constant offsets, scale and lag, fitted to pairs of their poses. Pure.

Model of a pair, in the frame of the target: `camera(t) = frame * reference(t - lag) * mounting`, and the camera's
distance from the tag is multiplied by a scale. Frame and mounting are constant rigid transforms. A flight that does not
separate two of these quantities leaves both at what is known before it (`Quantity.prior`), and the result says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

DROP_OUT: Final = 2.5
"""A longer pause than this many usual intervals is a drop-out; nothing is interpolated over one."""
LEAST_PAIRS: Final = 50
"""Fewer pairs give no figures: a p90 of them would rest on five values."""
FITTED: Final = 1000
"""Pairs that the offsets are fitted to, evenly chosen; more do not change them."""
LAGS: Final = np.arange(-0.6, 0.601, 0.02)
"""Lags that are tried first [s]; `max_age` of a source is 0.5 s at most."""
BLOCKS: Final = 8
"""Parts of the recording that are left out in turn, for the standard deviations (jackknife)."""


class Group(NamedTuple):
    """Quantities with one cause.

    Attributes:
        name: of it.
        cause: what a deviation means, and what to do.
        need: how to fly so that a recording determines it.
    """

    name: str
    cause: str
    need: str


class Quantity(NamedTuple):
    """A constant that is fitted.

    Attributes:
        name: of it.
        group: it belongs to.
        unit: that it is shown in.
        factor: from SI to that.
        prior: standard deviation before the recording [SI]; much smaller for the mounting than for the frame, so that
            the frame takes what cannot be separated.
        known: largest standard deviation with which it counts as determined [SI].
        finds: least size that is worth a sentence [SI].
    """

    name: str
    group: Group
    unit: str
    factor: float
    prior: float
    known: float
    finds: float


FRAME: Final = Group(
    "frame of the reference",
    "it lies differently from the target: correct `position` and `rpy_deg` of its section in [[positions]]",
    "fly sideways by a metre or more",
)
MOUNTING: Final = Group(
    "mounting",
    "correct the camera's mount (mkdaemon calibrate mount), or `body_position` and `body_rpy_deg` of the reference",
    "turn by 90 degrees each way, and tilt",
)
SCALE: Final = Group(
    "position scale",
    "the camera measures wrong distances: measure the print, compare it with `size` in the file of the target, then "
    "calibrate the camera again",
    "fly at three heights, the highest twice the lowest",
)
LAG: Final = Group(
    "lag",
    "positive: the camera's stamps are late; check `stamped_by` of its poses and `age` in the reports of the reference",
    "fly quickly to and fro",
)
_DEG: Final = math.degrees(1.0)
QUANTITIES: Final = (
    *(Quantity(f"frame, turn about {axis}", FRAME, "deg", _DEG, 3.0, 0.01, 0.009) for axis in "xyz"),
    *(Quantity(f"frame, {axis}", FRAME, "cm", 100.0, 10.0, 0.02, 0.01) for axis in "xyz"),
    *(Quantity(f"mounting, {axis}", MOUNTING, "deg", _DEG, 0.1, 0.01, 0.009) for axis in ("roll", "pitch", "yaw")),
    *(Quantity(f"mounting, {axis}", MOUNTING, "cm", 100.0, 0.1, 0.02, 0.01) for axis in ("forward", "left", "up")),
    Quantity("position scale, less 1", SCALE, "%", 100.0, 0.1, 0.01, 0.005),
    Quantity("lag of the camera's stamps", LAG, "ms", 1000.0, 0.3, 0.01, 0.01),
)
"""Worth a sentence: a tenth of the errors that endanger a landing, 10 cm, 5 degrees, 0.1 s, and of the scale at 2 m."""
_PRIOR: Final = np.array([one.prior for one in QUANTITIES])
_KNOWN: Final = np.array([one.known for one in QUANTITIES])
_STEP: Final = np.array([1e-4] * 13 + [5e-3])
"""Of numeric derivatives [rad, m, 1]; of the lag [s], less than an interval of any reference."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseTrack:
    """Poses over time.

    Attributes:
        times: (n,), increasing [s].
        positions: of the vehicle in the target frame (n, 3) [m].
        rotations: target from FLU (n, 3, 3).
        latencies: from the moment to the publication (n,) [s].
    """

    times: Array
    positions: Array
    rotations: Array
    latencies: Array

    @property
    def period(self) -> float:
        """Usual interval [s]."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else math.inf

    def pauses(self) -> list[tuple[float, float]]:
        """Begin and end [s] of every pause that is no usual interval."""
        longest = DROP_OUT * self.period
        return [(begin, end) for begin, end in pairwise(self.times.tolist()) if end - begin > longest]

    def at(self, times: Array) -> tuple[Mask, Array, Array]:
        """Where it is known (m,), and positions (m, 3) and rotations (m, 3, 3) between the two neighbours."""
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        begin, end = self.times[after - 1], self.times[after]
        known = (times >= begin) & (times <= end) & (end - begin <= DROP_OUT * self.period)
        share = np.clip((times - begin) / (end - begin), 0.0, 1.0)[:, None]
        positions = (1.0 - share) * self.positions[after - 1] + share * self.positions[after]
        first, second = self.rotations[after - 1], self.rotations[after]
        return known, positions, first @ rotations_by(share * rotation_vectors(first.transpose(0, 2, 1) @ second))


@dataclass(frozen=True, slots=True, eq=False)
class TagView:
    """What is seen, from where.

    Attributes:
        centres: of tags in the target frame (k, 3) [m].
        normals: out of their prints (k, 3).
        radii: half their diagonals (k,) [m].
        arm: camera in the body frame (3,) [m; FLU].
        flu_from_cam: (3, 3).
        lens: focal lengths, principal point, width, height (6,) [px]; None where nothing says what is in the image.
        is_fisheye: the projection is equidistant; distortion is left out of both.
    """

    centres: Array
    normals: Array
    radii: Array
    arm: Array
    flu_from_cam: Array
    lens: Array | None = None
    is_fisheye: bool = False

    def look(self, positions: Array, rotations: Array) -> tuple[Array, Array, Array, Mask]:
        """The nearest tag from poses (n, 3) and (n, 3, 3), of those in the image where there are any.

        Returns:
            Camera from that tag (n, 3) [m], the tag's place (n, 3) [m], cosine of the viewing angle (n,), and whether
            the tag is whole in the image (n,).
        """
        cameras = positions + rotations @ self.arm
        chosen, inside = np.zeros(len(cameras), dtype=int), np.ones(len(cameras), dtype=bool)
        for begin in range(0, len(cameras), 1000):  # 500 tags of 20,000 images at once would take a gigabyte
            part = slice(begin, begin + 1000)
            away = cameras[part, None] - self.centres
            seen = self._is_inside(-away @ (rotations[part] @ self.flu_from_cam))
            rank = np.linalg.norm(away, axis=2) + np.where(seen, 0.0, 1e6)
            chosen[part], inside[part] = rank.argmin(axis=1), seen.any(axis=1)
        away = cameras - self.centres[chosen]
        cosine = (away * self.normals[chosen]).sum(axis=1) / np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        return away, self.centres[chosen], cosine, inside

    def _is_inside(self, seen: Array) -> Mask:
        """Whether tags (n, k, 3) [m; RDF] are whole in the image."""
        if self.lens is None:
            return np.ones(seen.shape[:2], dtype=bool)
        fx, fy, cx, cy, width, height = self.lens
        depth, off = np.maximum(seen[..., 2], 1e-3), np.hypot(seen[..., 0], seen[..., 1])
        bent = np.arctan2(off, depth) * depth / np.maximum(off, 1e-9) if self.is_fisheye else 1.0
        u, v = cx + fx * bent * seen[..., 0] / depth, cy + fy * bent * seen[..., 1] / depth
        margin = fx * self.radii / depth
        fits: Mask = (u > margin) & (u < width - margin) & (v > margin) & (v < height - margin)
        fits &= seen[..., 2] > 0.0
        return fits


def aligned(reference: PoseTrack, times: Array, values: Array) -> tuple[Mask, Array, Array]:
    """Where the reference saw the camera's vehicle at times (n,) [s], in the camera's target frame.

    Args:
        reference: the base line.
        times: by the camera's clock.
        values: of `QUANTITIES` (14,).

    Returns:
        Where it is known (n,), positions (n, 3) [m], rotations (n, 3, 3).
    """
    frame, mounting = rotations_by(values[None, 0:3])[0], rotations_by(values[None, 6:9])[0]
    known, positions, rotations = reference.at(times - values[13])
    carried = frame @ rotations
    return known, positions @ frame.T + values[3:6] + carried @ values[9:12], carried @ mounting


class Pairs:
    """Fits the constants: Gauss-Newton on all of them, with Cauchy weights, priors and numeric derivatives."""

    def __init__(self, camera: PoseTrack, reference: PoseTrack, sight: TagView) -> None:
        chosen = np.unique(np.linspace(0, len(camera.times) - 1, FITTED).astype(int))
        self._times, self._positions = camera.times[chosen], camera.positions[chosen]
        self._rotations, self._reference, self._arm = camera.rotations[chosen], reference, sight.arm
        self._tags = sight.look(self._positions, self._rotations)[1]

    def fitted(self) -> tuple[Array, Array]:
        """Values and standard deviations (14,), (14,) [SI]."""
        everything = np.ones(len(self._times))
        values, covariance = self._fit(self._start(), everything, 20)
        parts = np.array_split(np.arange(len(self._times)), BLOCKS)
        others = []
        for part in parts:
            left = everything.copy()
            left[part] = 0.0
            others.append(self._fit(values, left, 4)[0])
        varied = (BLOCKS - 1) * np.var(others, axis=0)
        return values, np.sqrt(varied + np.diag(covariance))

    def _start(self) -> Array:
        """The lag with the smallest misfit, then the best of three frames."""
        costs, starts = [], []
        for lag in LAGS:
            known, positions, rotations = self._reference.at(self._times - lag)
            if known.sum() < LEAST_PAIRS:
                costs.append(math.inf)
                starts.append(np.zeros(14))
                continue
            cost, start = self._frame(known, positions, rotations)
            start[13] = lag
            costs.append(cost)
            starts.append(start)
        # Of lags that fit equally well, as where nothing moves, the one next to none.
        good = [k for k, cost in enumerate(costs) if cost <= 1.02 * min(costs)]
        return starts[min(good, key=lambda k: abs(LAGS[k]))]

    def _frame(self, known: Mask, positions: Array, rotations: Array) -> tuple[float, Array]:
        """Misfit and start for the poses of the reference that are known at one lag."""
        here, there = self._positions[known], positions[known]
        mine, theirs = self._rotations[known], rotations[known]
        moved = (here - here.mean(axis=0)).T @ (there - there.mean(axis=0))
        found: list[tuple[float, Array]] = []
        for frame in (np.eye(3), nearest_rotation(moved), nearest_rotation((mine @ theirs.transpose(0, 2, 1)).mean(0))):
            mounting = nearest_rotation(((frame @ theirs).transpose(0, 2, 1) @ mine).mean(axis=0))
            off = here - there @ frame.T
            place = np.median(off, axis=0)
            turns = rotation_vectors((frame @ theirs @ mounting).transpose(0, 2, 1) @ mine)
            cost = float(np.median(np.linalg.norm(off - place, axis=1)) / 0.01)
            cost += math.degrees(float(np.median(np.linalg.norm(turns, axis=1))))
            start = np.concatenate(
                [rotation_vectors(frame[None])[0], place, rotation_vectors(mounting[None])[0], np.zeros(5)]
            )
            found.append((cost, start))
        return min(found, key=lambda one: one[0])

    def _residuals(self, values: Array) -> tuple[Mask, Array]:
        """Where the reference is known (n,), and residuals of position [m] and rotation [rad] (n, 6)."""
        known, positions, rotations = aligned(self._reference, self._times, values)
        seen = self._tags + math.exp(values[12]) * (positions + rotations @ self._arm - self._tags)
        off = self._positions + self._rotations @ self._arm - seen
        return known, np.hstack([off, rotation_vectors(rotations.transpose(0, 2, 1) @ self._rotations)])

    def _fit(self, start: Array, weights: Array, rounds: int) -> tuple[Array, Array]:
        """Values (14,) and their covariance (14, 14)."""
        values, covariance = start.copy(), np.diag(_PRIOR**2)
        for _ in range(rounds):
            known, residuals = self._residuals(values)
            slopes = np.stack([self._residuals(values + step)[1] - residuals for step in np.diag(_STEP)], axis=2)
            slopes /= _STEP
            used = weights * known
            if not used.any():
                break
            sizes = np.linalg.norm(residuals.reshape(-1, 2, 3), axis=2)
            # The median length of three normal errors is 1.54 standard deviations; not below 0.5 mm and 0.02 degrees.
            sds = np.maximum(np.median(sizes[used > 0], axis=0) / 1.54, (5e-4, 3.5e-4))
            weight = np.repeat(used[:, None] / (1.0 + (sizes / (3.0 * sds)) ** 2) / sds**2, 3, axis=1)
            normal = np.einsum("nij,ni,nik->jk", slopes, weight, slopes) + np.diag(_PRIOR**-2)
            covariance = np.linalg.inv(normal)
            step = covariance @ (np.einsum("nij,ni,ni->j", slopes, weight, residuals) + values / _PRIOR**2)
            values = values - step
            values[13] = np.clip(values[13], LAGS[0], LAGS[-1])
            if (np.abs(step) < 0.01 * _KNOWN).all():
                break
        return values, covariance


def rotation_vectors(rotations: Array) -> Array:
    """Rotation vectors (n, 3) [rad] of rotations (n, 3, 3): axis by angle; half a turn is short of its axis."""
    axis = 0.5 * np.stack([rotations[:, i, j] - rotations[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    sine, cosine = np.linalg.norm(axis, axis=1), (np.trace(rotations, axis1=1, axis2=2) - 1.0) / 2.0
    angle = np.arctan2(sine, cosine)
    vectors: Array = axis * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[:, None]
    return vectors


def rotations_by(vectors: Array) -> Array:
    """Rotations (n, 3, 3) of rotation vectors (n, 3) [rad], by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    for (i, j), part in (((2, 1), 0), ((0, 2), 1), ((1, 0), 2)):
        cross[:, i, j], cross[:, j, i] = vectors[:, part], -vectors[:, part]
    first = np.sinc(angle / math.pi)
    second = 0.5 * np.sinc(angle / (2.0 * math.pi)) ** 2
    rotations: Array = np.eye(3) + first * cross + second * cross @ cross
    return rotations


def nearest_rotation(matrix: Array) -> Array:
    """The rotation (3, 3) next to a matrix (3, 3). Source: Kabsch, Acta Crystallographica A32 (1976) 922."""
    left, _, right = np.linalg.svd(matrix)
    rotation: Array = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return rotation
