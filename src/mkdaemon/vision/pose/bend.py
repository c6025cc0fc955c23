"""A print that does not lie flat: how its paper bends is an unknown of a fit, known to a share of its side.

Over the plane of a print paper lies at the height z = s (a X^2 + b X Y + c Y^2) - z0, where X and Y are places in
halves of the side s, and z0 makes the mean over the print zero: its frame lies in the plane of least squares. The rise
(a, b, c) is a share of the side. A bend moves points along the normal. Near by, edges tell that from a tilt; from afar
they do not, where the print is seen at a slant.

Paper bends and does not stretch: with Q the matrix of z = p^T Q p a point p of the flat sheet comes to lie at
p - 2/3 (p^T Q p) Q p, to third order, which is the chord of its arc.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.tags.tagmap import Tag

RISES: Final = 3
"""Unknowns a, b, c."""
OF_A_CYLINDER: Final = np.array([[0.375, 0.0, 0.125], [0.0, 0.5, 0.0], [0.125, 0.0, 0.375]])
"""Covariance of (a, b, c) over the variance of the rise, for a cylinder about any axis: (cos^2, 2 cos sin, sin^2)."""
PLANE: Final = 0.3
"""Deviation of the mean height over the print's own: nobody tells how far its sheet reaches beyond the quiet zone (a
margin of a tenth of the side changes the mean by 0.3 of it)."""


@dataclass(frozen=True, slots=True, eq=False)
class Bend:
    """What is known about the rise of a print.

    Attributes:
        mean: a, b, c `(3,)`, in shares of the side.
        covariance: of them `(3, 3)`.
    """

    mean: Array
    covariance: Array

    @property
    def information(self) -> Array:
        """Inverse of the covariance `(3, 3)`."""
        return np.asarray(np.linalg.inv(self.covariance), np.float64)


class Sheet:
    """The sheet of one print.

    Args:
        tag: the largest tag of the print.
        rise: deviation of the rise at the middle of a side over the centre, as a share of the side.

    Attributes:
        prior: what is known before any image.
        normal: of the print `(3,)` [target].
    """

    def __init__(self, tag: Tag, rise: float) -> None:
        self.prior = Bend(np.zeros(RISES), rise**2 * OF_A_CYLINDER)
        self.normal = tag.rotation[:, 2]
        self._origin, self._axes = tag.position, tag.rotation[:, :2]
        self._scale = 4.0 / tag.size
        mean = (tag.paper / tag.size) ** 2 / 3.0
        self._mean = tag.size * np.array([mean, 0.0, mean])

    def heights(self, x: Array, y: Array) -> Array:
        """Derivative `(3, n)` [m] of the height over the plane by the rise, at places `(n,)` along the axes [m]."""
        heights: Array = self._scale * np.stack([x * x, x * y, y * y]) - self._mean[:, None]
        return heights

    def terms(self, points: Array) -> Array:
        """What the place of points `(n, 3)` on the bent print is made of `(7, n)`: their heights, then cubes [m^3]."""
        x, y = ((points - self._origin) @ self._axes).T
        return np.concatenate([self.heights(x, y), np.stack([x**3, x * x * y, x * y * y, y**3])])

    def bent(self, points: Array, terms: Array, rise: Array) -> Array:
        """Where points `(n, 3)` [m; target] of the flat print lie on the bent one.

        Args:
            points: of the print.
            terms: of theirs.
            rise: a, b, c `(3,)`.
        """
        # (a x^2 + b x y + c y^2) (a x + b y / 2, b x / 2 + c y), sorted by x^3, x^2 y, x y^2, y^3.
        a, b, c = rise * self._scale
        along_x = [a * a, 1.5 * a * b, a * c + b * b / 2, b * c / 2]
        along_y = [a * b / 2, a * c + b * b / 2, 1.5 * b * c, c * c]
        chord = (-2.0 / 3.0) * self._axes @ np.array([along_x, along_y])
        bent: Array = points + (np.column_stack([np.outer(self.normal, rise), chord]) @ terms).T
        return bent

    def plane_covariance(self, rotation: Array, bend: Bend) -> Array:
        """Covariance `(3, 3)` [m^2; camera] of where the print's plane lies along its normal, seen by a rotation."""
        square = bend.covariance + np.outer(bend.mean, bend.mean)
        normal = rotation @ self.normal
        return float(PLANE**2 * self._mean @ square @ self._mean) * np.outer(normal, normal)
