"""The tests that a fitted pose must pass before it is published."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import log
from typing import Final

import numpy as np

from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.arrays import Array, Bools, Grey, Numbers
from mkdaemon.vision.limits import HALF, LIMITS, NOISE_GREY
from mkdaemon.vision.pose.ambiguity import facts
from mkdaemon.vision.pose.edgemodel import EdgeModel
from mkdaemon.vision.pose.pose import Pose, largest_variance, quantile
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.unknowns import motion_cost
from mkdaemon.vision.tags.cellread import sample
from mkdaemon.vision.tags.tagfamily import coded
from mkdaemon.vision.tags.tagmap import Tag, Target

CLEAR: Final = 3.0 * LIMITS.ambiguity.decided
"""What cells say that are read clearly: as much as three images that decide [nats]."""
USUAL: Final = 0.75
"""Quantile of the contrast of pairs that a print has; less than half of it is none."""
ENOUGH: Final = 0.42
"""Share of what they say of a print in full view. Edges that agree, rightly or not, bring some cells along: wrong fits
said 0.39 of it and less, right ones below a highlight, a board and leaves 0.46 and more."""


@dataclass(frozen=True, slots=True)
class CellEvidence:
    """Evidence of a target's cells for a pose, against anything but the target [nats].

    Attributes:
        odds: of the tag that says most for it: another one may be hidden; zero if there is no evidence.
        most: that this tag says where all that is in view is read, and nothing hides a part.
        together: of all tags.
        code: what the pairs inside of codes say, of the tag that they say most for.
        most_code: as `most`, of these.
    """

    odds: float = 0.0
    most: float = 0.0
    together: float = 0.0
    code: float = 0.0
    most_code: float = 0.0

    @property
    def is_clear(self) -> bool:
        """Whether all that is in view is read clearly."""
        return self.together >= CLEAR

    @property
    def vouches(self) -> bool:
        """Whether a tag is read clearly, or says enough where little of it is in view."""
        return self.odds >= min(CLEAR, ENOUGH * self.most)

    @property
    def has_code(self) -> bool:
        """Whether a code is read too, as far as it is in view: a dark tile is a border around nothing."""
        return self.code >= min(HALF * LIMITS.ambiguity.decided, ENOUGH * self.most_code)


class CellReader:
    """Reads the cells of a target.

    Two neighbouring cells of which one is black are a pair. It is read where the white one is brighter: light that
    changes over the print moves both. With a share e of pairs misread, and a share s of the print in view, a pair is
    read with the probability p = 1/2 + (1/2 - e) s, and something else than the print reads so with 1/2. So each says
    ln(2 p) for the print where it is read, and ln(2 (1 - p)) where the black one is brighter. Where both are alike
    something even lies over them, or near them: that says neither.
    """

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        model = EdgeModel.of(target, per_cell=1)
        cells = range(-LIMITS.read.beside_cells, LIMITS.read.beside_cells + 1)
        steps = np.array([(0.0, 0.0), *(step for step in product(cells, repeat=2) if any(step))])
        ways = np.array([tag.module * tag.rotation[:, :2].T for tag in target.tags])
        # Of each pair: side of a cell [m], its middles, the black one first `(2, n, 3)`, steps to where it would lie
        # whole cells beside its place `(k, n, 3)`, the first being none [m; target], and its tag `(n, tags)`.
        self._cell, self._ends = model.cell, model.sides
        self._steps = (steps @ ways)[model.tag].transpose(1, 0, 2)
        self._is_of = model.tag[:, None] == np.arange(len(target.tags))
        of_code = self._is_of & np.array([_is_coded(tag, model.sides) for tag in target.tags]).T
        # Which pairs are those of each tag, and of its code `(2, n, tags)`.
        self._asked = np.array([self._is_of, of_code], dtype=np.intp)

    def evidence(self, pixels: Grey, pose: Pose) -> CellEvidence:
        """Evidence of the image for a pose: its cells, or all pixels of a fit to grey values.

        Edges that agree say what share of the cells is in view. Of n pixels and the likeness L grey values say
        n / 2 ln(1 / (1 - L^2)), the `log_odds` of an even print. A motion that no camera has speaks against it.
        """
        cost = motion_cost(pose, self._projection.shutter)
        if pose.likeness is not None:
            half, best = HALF * facts(pose.points, pose.shared), LIMITS.likeness.explained
            odds, most = (-half * log(1.0 - alike**2) for alike in (min(max(pose.likeness, 0.0), best), best))
            return CellEvidence(odds - cost, most, odds - cost)
        right, wrong = _odds(pose.inliers)
        pairs = self._pairs(pixels, pose)[:, 0]
        every, code = (
            [(read * right + misread * wrong, in_view * _odds(1.0)[0]) for read, misread, in_view in counts if in_view]
            for counts in (pairs @ self._asked).swapaxes(1, 2).tolist()
        )
        if not every:
            return CellEvidence()
        odds, most = max(every)
        together = sum(odds for odds, _ in every)
        return CellEvidence(odds - cost, most, together - cost, *max(code, default=(0.0, 0.0)))

    def shows(self, pixels: Grey, pose: Pose) -> bool:
        """Whether half of the pairs in view are read where a pose puts them, as they are from within half a cell."""
        read, _, in_view = self._read(pixels, pose)[:, 0].sum(axis=1).tolist()
        return bool(read >= HALF * in_view)

    def beside(self, pixels: Grey, pose: Pose) -> float:
        """By how much more cells speak for a place some whole cells beside, of the tag for which that is most [nats].

        What is hidden is read nowhere, so that what is even speaks against a place here.
        """
        right, wrong = _odds(pose.inliers)
        read, _, in_view = self._read(pixels, pose, beside=True)
        odds = read * right + (in_view - read) * wrong
        return float((odds.max(axis=0) - np.maximum(odds[0], 0.0)).max())

    def _read(self, pixels: Grey, pose: Pose, *, beside: bool = False) -> Numbers:
        """How many pairs are read, misread, and in view, in their place and whole cells beside `(3, steps, tags)`."""
        return np.asarray(self._pairs(pixels, pose, beside=beside) @ self._asked[0])

    def _pairs(self, pixels: Grey, pose: Pose, *, beside: bool = False) -> Bools:
        """Whether each pair is read, misread, and in view, in its place and whole cells beside `(3, steps, n)`."""
        steps = self._steps if beside else self._steps[:1]
        points = (self._ends[:, None] + steps).reshape(-1, 3)
        seen, _ = self._projection.exposed((pose.rotation @ points.T + pose.position[:, None]).T, pose.motion)
        uv, visible = self._projection.project(seen)
        visible &= (np.minimum(uv, np.array(pixels.shape[::-1]) - 1 - uv) > 1.0).all(axis=1)
        black, white = sample(pixels, np.where(visible[:, None], uv, 0.0)).reshape(2, len(steps), -1)
        depth, focal = seen[:, 2].reshape(2, *black.shape), float(self._projection.focal[0])
        is_readable = LIMITS.cells.readable_px * depth < self._cell * focal
        # Where a highlight floods both, they say nothing.
        in_view = (visible.reshape(depth.shape) & is_readable).all(axis=0)
        in_view &= np.minimum(black, white) < LIMITS.read.saturated
        # Ink darkens paper by a share, in the sun and in the shade.
        rise = (white - black) / np.maximum(np.maximum(white, black), 1.0)
        size, usual = np.abs(rise), np.zeros(len(self._cell))
        for is_of in self._is_of.T:
            asked = in_view & is_of
            usual += is_of * (HALF * quantile(size[asked], USUAL) if bool(asked.any()) else 0.0)
        clear = in_view & (np.abs(white - black) > NOISE_GREY) & (size > usual)
        return np.array([clear & (rise > 0.0), clear & (rise < 0.0), in_view])


def _is_coded(tag: Tag, ends: Array) -> Bools:
    """Whether both cells of pairs, by their middles `(2, n, 3)` [m; target], carry bits of a tag `(n,)`."""
    n = tag.family.black_cells
    column, row = np.floor(tag.local(ends)[..., :2] * (1.0, -1.0) / tag.module + n / 2).astype(np.intp).clip(-1, n).T
    # Around the print it is white.
    return np.asarray(np.pad(coded(tag.family), 1)[row + 1, column + 1].all(axis=1))


def _odds(shown: float) -> tuple[float, float]:
    """What a pair says for a print of which a share is in view where it is read, and where it is not [nats]."""
    read = HALF + (HALF - LIMITS.read.misread) * shown
    return log(2.0 * read), log(2.0 * (1.0 - read))


def fit_refusal(pose: Pose, cfg: TrackerSection) -> PoseRefusal | None:
    """Fault of a fit by itself; None without one."""
    # Four corners that neither edges nor grey values confirm vouch for nothing.
    signs = (
        (pose.source == "corners", PoseRefusal.NO_FIT),
        (pose.inliers < cfg.min_inlier_fraction, PoseRefusal.INLIERS),
        (pose.points < cfg.min_points, PoseRefusal.POINTS),
        (pose.unexplained_px > cfg.max_rms_px, PoseRefusal.RESIDUAL),
        (pose.step > cfg.max_step, PoseRefusal.STEP),
    )
    return next((refusal for is_wrong, refusal in signs if is_wrong), None)


def certainty_refusal(pose: Pose, *, has_attitude: bool) -> PoseRefusal | None:
    """Refuse poses whose own covariance or residual says they may be wrong; none when certain enough.

    `has_attitude`: whether an attitude stands against it.
    """
    certain = LIMITS.certainty
    if not has_attitude and pose.unexplained_px > certain.blind_rms_px:
        return PoseRefusal.RESIDUAL
    variance = largest_variance(pose.covariance[3:, 3:])
    if not np.isfinite(variance) or variance > (certain.angle_sd if has_attitude else certain.blind_angle_sd) ** 2:
        return PoseRefusal.ANGLE_UNCERTAIN
    spread = float(np.sqrt(largest_variance(pose.covariance[:3, :3])))
    if spread > max(certain.wrong_m, certain.wrong_share * pose.range_m) / certain.deviations:
        return PoseRefusal.POSITION_UNCERTAIN
    return None
