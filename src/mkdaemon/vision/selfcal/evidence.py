"""What the edges of one image say about the lens, the sizes of the tags, and the pose.

With d the offsets of the edges from where a pose puts them, J their derivative by that pose and by a common shift, and
C their derivative by what else may be wrong, d = J x + C p. The pose that the image alone asks for is x(p) = x0 - X p
with X = (J^T W J)^-1 J^T W C, and what is left says about p as much as the information A = C^T W C - C^T W J X.
Source: the Schur complement of a bundle adjustment, Triggs et al., Vision Algorithms, LNCS 1883, 2000, section 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.edgefit import LEAST_EDGES, EdgeFit, LocatedEdges
from mkdaemon.vision.pose.edgestep import MAD, damped
from mkdaemon.vision.pose.pose import Pose, median, turn
from mkdaemon.vision.pose.prints import sheet_of
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.tagmap import Target

LENS: Final = ("focal", "cx", "cy", "k1")
"""What may be wrong with a lens: logarithm of the focal lengths, principal point [px], radial distortion."""
ALIGNED_PX: Final = 0.08
"""Error that the edges of a tag's side share where it runs along a row of pixels [px]: all lie between the same two. It
falls with the rows that a side crosses. Measured: errors over deviations, docs/lab/accuracy.md."""
SHIFTED: Final = 0.15
"""The same for each pixel all edges are shifted by: a tone curve or sharpening bends them too."""
ROLLING_PX: Final = 0.3
"""The same under a rolling shutter, whose motion is part of the error [px]."""
APART: Final = 0.5
"""Distance between centres from which tags are beside each other, sides of the largest one."""
MOST_SIZES: Final = 8
"""Targets of more tags share one unknown size."""
SHIFT_SD_PX: Final = 0.5
"""How far all edges may be shifted together [px]."""
MELTS: Final = 5
"""Small cells look smaller by a share that falls with this power of their side: neighbours pull their edges. Measured:
docs/lab/vision-cases.md."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageEvidence:
    """One image's say about unknowns `(k,)`: the lens in the order of `LENS`, sizes, melting, the rise of a bent print.

    Attributes:
        rotation: camera from target by the image alone, lens and sizes as believed `(3, 3)`.
        covariance: of that rotation `(3, 3)` [rad^2; camera].
        turn: how the rotation turns with the unknowns `(3, k)` [rad].
        matrix: information about the unknowns whatever the pose `(k, k)`; the cost is p^T matrix p - 2 pull^T p.
        pull: see `matrix` `(k,)`.
    """

    rotation: Array
    covariance: Array
    turn: Array
    matrix: Array
    pull: Array


class EvidenceMaker:
    """Asks images of one target.

    Attributes:
        sizes: tags 1 to `sizes` have an unknown each: the logarithm of their size against that of tag 0.
        is_spread: whether distances between tags say how large they all are, which is one more unknown.
        unknown_sizes: how many there are together.
        sheet: that bends, with three more unknowns; none for several prints, or a rigid one.
    """

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        self._fit = EdgeFit(target, projection)
        model = self._fit.model
        centres = np.array([tag.position for tag in target.tags])
        self._from_centre = model.points - centres[model.tag]
        self._tag = model.tag
        self._size = np.array([tag.size for tag in target.tags])[model.tag]
        self.sizes = len(target.tags) - 1 if len(target.tags) <= MOST_SIZES else 0
        apart = np.linalg.norm(centres - centres[0], axis=1).max()
        self.is_spread = bool(apart > APART * target.tags[0].size)
        self.unknown_sizes = self.sizes + self.is_spread
        self.sheet = sheet_of(target)
        self._shutter = projection.shutter

    def look(self, pixels: Grey, pose: Pose) -> ImageEvidence | None:
        """Ask an image `(h, w)` uint8 about a pose found in it; none when too few edges are seen."""
        edges = self._fit.locate(pixels, pose)
        if edges is None or int(edges.found.sum()) < LEAST_EDGES:
            return None
        smaller = self._fit.model.smaller[edges.index]
        smaller = smaller[:, smaller.any(axis=0) & ~smaller.all(axis=0)]
        shifted = np.column_stack([edges.jacobian, np.ones(len(edges.index)), smaller])
        seen = self._fit.model.points[edges.index] @ pose.rotation.T + pose.position
        columns = np.column_stack([self._by_lens(edges, seen), self._by_size(edges, pose), edges.by_rise])
        # The pose knows how its print bends in this image; here all images say so together.
        offsets = edges.offsets if pose.bend is None else edges.offsets + edges.by_rise @ pose.bend.mean
        crossed = np.abs(edges.normals).min(axis=1) * self._size[edges.index] * self._px_per_m(pose)
        shared = ALIGNED_PX**2 / (1.0 + crossed**2) + (SHIFTED * pose.shift_px) ** 2
        if self._shutter.rolls:
            shared += ROLLING_PX**2
        weights = _weights(np.column_stack([shifted, columns]), offsets, edges, shared)
        weighted = shifted * weights[:, None]
        normal = weighted.T @ shifted
        shift_sd = np.array([SHIFT_SD_PX, *[LIMITS.edges.shift_sd_px] * smaller.shape[1]])
        normal[6:, 6:] += np.diag(shift_sd**-2)
        normal = damped(normal)
        right = weighted.T @ offsets
        both = weighted.T @ columns
        follows: Array = np.asarray(np.linalg.solve(normal, both), dtype=np.float64)
        matrix = (columns * weights[:, None]).T @ columns - both.T @ follows
        pull = (columns * weights[:, None]).T @ offsets - follows.T @ right
        step: Array = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
        return ImageEvidence(
            turn(pose.rotation, step[3:6]),
            np.asarray(np.linalg.inv(normal)[3:6, 3:6], dtype=np.float64),
            -follows[3:6],
            (matrix + matrix.T) / 2,
            pull,
        )

    def _by_lens(self, edges: LocatedEdges, seen: Array) -> Array:
        """Derivative of the offsets by the lens `(n, 4)`."""
        centre = self._projection.centre
        bent = self._projection.k1_jacobian(seen)
        along, normals = (edges.pixels - centre) * edges.normals, edges.normals
        return np.column_stack([along.sum(axis=1), normals, (bent * normals).sum(axis=1)])

    def _by_size(self, edges: LocatedEdges, pose: Pose) -> Array:
        """Derivative of the offsets by the logarithms of the sizes, and by melting `(n, unknown_sizes + 1)`."""
        grown = (edges.jacobian[:, :3] * (self._from_centre[edges.index] @ pose.rotation.T)).sum(axis=1)
        tag = self._tag[edges.index]
        own = [np.where(tag == k, grown, 0.0) for k in range(1, self.sizes + 1)]
        cell_px = self._fit.model.cell[edges.index] * self._px_per_m(pose)
        melts = (LIMITS.cells.readable_px / cell_px) ** MELTS
        return np.column_stack([*own, *([grown] if self.is_spread else []), grown * melts])

    def _px_per_m(self, pose: Pose) -> float:
        """Of the target in the image."""
        return float(self._projection.focal[0] / pose.position[2])


def _weights(jacobian: Array, offsets: Array, edges: LocatedEdges, shared: Array) -> Array:
    """Tukey's weights of the offsets over their variance [1/px^2], around the best that all unknowns can do.

    `shared` is the variance of errors that no residual shows, as edges share them `(n,)` [px^2].
    """
    found, root = edges.found, np.sqrt(edges.trust)
    jacobian, offsets = jacobian * root[:, None], offsets * root
    weights = found.astype(np.float64)
    residual = offsets
    for _ in range(3):
        weighted = jacobian * weights[:, None]
        residual = offsets - jacobian @ np.linalg.solve(damped(weighted.T @ jacobian), weighted.T @ offsets)
        spread = max(MAD * median(np.abs(residual[found])), LIMITS.edges.least_scale_px)
        reach = LIMITS.edges.tukey * spread
        weights = np.maximum(1.0 - (residual / reach) ** 2, 0.0) ** 2 * found
    # Doubt makes residuals small: by as much less they say how large residuals are.
    weights = edges.trust * weights
    variance = float((weights * residual**2).sum()) / max(float(weights.sum()) - jacobian.shape[1], 1.0)
    scaled: Array = weights / (variance + shared)
    return scaled
