"""Unknowns of an edge fit beside the pose: what the camera does that nobody asked for.

Each adds columns to the derivative of the offsets and a cost that says how far it is known: a prior is a normal matrix
`(k, k)` and a right side `(k,)` in units of a located edge's variance, the pose first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.bend import BentPrint
from mkdaemon.vision.pose.edgefind import Samples
from mkdaemon.vision.pose.edgelight import Blown
from mkdaemon.vision.pose.linetime import MOTIONS, KnownMotion, Shutter
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import motion_at_rest, skew

Prior = tuple[Array, Array]

BEYOND: Final = 5
"""Unknowns of what a motion lacks: three angular accelerations, two speeds."""


def with_shift(
    samples: Samples,
    prior: Prior,
    toned: Array,
    smaller: npt.NDArray[np.bool_] | None,
    edge_px: float,
) -> tuple[Samples, Prior]:
    """A common shift s of all edges in proportion to their blur, the last unknown, and that of smaller tags.

    J gains `toned`, the cost is s^2 over its variance. Blur does not let small cells get black or white: a tone curve
    or sharpening shifts their edges by less, or more. Behind gamma 2.2 and a webcam one shift for both tags of a nested
    target left the range off by 0.8 and 1.4 mm at 1.2 m, 0.2 and 0.3 mm with one each.

    Args:
        samples: whose edges were found.
        prior: of the unknowns so far.
        toned: shift of each over that of all `(n,)`.
        smaller: which of them are on tags of each smaller size `(n, k)`; none while the place is not nearly known.
        edge_px: deviation of a located edge [px].
    """
    if smaller is None:
        smaller = np.zeros((len(samples.index), 0), dtype=bool)
    seen = smaller[:, smaller.any(axis=0) & ~smaller.all(axis=0)]
    count = seen.shape[1]
    spread = np.full(count + 1, LIMITS.edges.shift_sd_px)
    jacobian = np.column_stack([samples.jacobian, *(seen.T * toned), toned])
    return replace(samples, jacobian=jacobian), _grown(prior, (edge_px / spread) ** 2, np.zeros(count + 1))


def with_blown(samples: Samples, prior: Prior, blown: Blown, edge_px: float) -> tuple[Samples, Prior]:
    """Blur and contrast of blown edges, as shares off what was taken for them: J gains what they change.

    Args:
        samples: whose edges were found.
        prior: of the unknowns so far.
        blown: what clipping does to the edges.
        edge_px: deviation of a located edge [px].
    """
    count = blown.columns.shape[1]
    grown = _grown(prior, np.full(count, (edge_px / LIMITS.edges.clipped_sd) ** 2), np.zeros(count))
    return replace(samples, jacobian=np.hstack([samples.jacobian, blown.columns])), grown


def with_bend(prior: Prior, bent: BentPrint, edge_px: float) -> Prior:
    """The rise r of the print, whose columns J has behind the pose: the cost is |r - expected|^2 by its covariance."""
    weight = edge_px**2 * bent.information
    return _joined(prior, weight, weight @ (bent.known.mean - bent.rise))


def with_stretch(
    samples: Samples, prior: Prior, projection: Projection, stretch: float, weight: float
) -> tuple[Samples, Prior]:
    """The ratio s of the focal lengths: J gains n . du/ds, the cost (w s)^2; the projection has `stretch` in it."""
    column = (samples.normals * projection.stretch_jacobian(samples.pixels)).sum(axis=1)
    grown = _grown(prior, np.array([weight**2]), np.array([-(weight**2) * stretch]))
    return replace(samples, jacobian=np.column_stack([samples.jacobian, column])), grown


def with_motion(
    samples: Samples,
    prior: Prior,
    start: Pose,
    motion: Array,
    position: Array,
    edge_px: float,
    shutter: Shutter,
) -> tuple[Samples, Prior]:
    """The motion m under a rolling shutter, whose columns J has, and the angular acceleration a meanwhile.

    The costs are |(m - expected) / spread|^2 and |a / sd|^2. An acceleration bends the image by a t^2 / 2, so J gains
    t / 2 times the columns of the rates. A speed e across the line of sight is in m as a turn, which is right at the
    target's origin P0 only: J gains what either axis moves beyond that turn, t (e - w x P) with w = P0 x e / P0^2.
    Neither is carried from step to step, each asks for all of it.

    Args:
        samples: with the motion as their last columns.
        prior: of the pose.
        start: of the fit; may know the motion.
        motion: that the samples were projected with `(4,)`.
        position: of the target `(3,)` [m; RDF].
        edge_px: deviation of a located edge [px].
        shutter: what is known of the line time.
    """
    known = motion_known(start, shutter)
    weight = (edge_px / np.concatenate([known.spread, beyond_sd(shutter)])) ** 2
    beyond = beyond_motion(samples.jacobian[:, -MOTIONS:], samples.jacobian, samples.times, position)
    grown = _grown(prior, weight, weight * np.concatenate([known.expected - motion, np.zeros(BEYOND)]))
    return replace(samples, jacobian=np.hstack([samples.jacobian, beyond])), grown


def beyond_motion(by_motion: Array, by_place: Array, times: Array, position: Array) -> Array:
    """Derivative `(n, 5)` by what the motion lacks: the angular acceleration [rad/s^2], a speed across [m/s].

    Args:
        by_motion: derivative by the motion `(n, 4)`.
        by_place: derivative by the target's position, and maybe more `(n, 2 or more)`.
        times: of the rows `(n,)` [s].
        position: of the target `(3,)` [m; RDF].
    """
    rates = by_motion[:, :3]
    # With n . u x P = u . P x n the turn in place of a speed e is the columns of the rates times P0 x e / P0^2.
    instead = skew(position)[:, :2] / float(position @ position)
    slide = times[:, None] * by_place[:, :2] + rates @ instead
    return np.hstack([rates * (times[:, None] / 2), slide])


def beyond_sd(shutter: Shutter) -> Array:
    """How far that is known `(5,)`, times the line time over the nominal one; of an acceleration twice."""
    scale = shutter.scale
    return np.array([LIMITS.edges.acceleration_sd * scale**2] * 3 + [LIMITS.edges.speed_sd * scale] * 2)


def motion_known(start: Pose, shutter: Shutter) -> KnownMotion:
    """What is known of the motion before a fit looks at the image."""
    known = start.known_motion
    if known is None:
        known = KnownMotion(motion_at_rest(), np.array([LIMITS.edges.turning_sd] * 3 + [LIMITS.edges.speed_sd]))
    return shutter.motion(known)


def _grown(prior: Prior, weight: Array, pull: Array) -> Prior:
    """A prior with more unknowns, independent of the others and of each other."""
    return _joined(prior, np.diag(weight), pull)


def _joined(prior: Prior, weight: Array, pull: Array) -> Prior:
    """A prior with more unknowns, independent of the others."""
    matrix, right = prior
    count = len(right) + len(weight)
    grown = np.zeros((count, count))
    grown[: len(right), : len(right)] = matrix
    grown[len(right) :, len(right) :] = weight
    return grown, np.concatenate([right, pull])
