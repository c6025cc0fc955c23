"""A print rendered on a grid finer than the pixels, and what it says at each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]
Grey = npt.NDArray[np.uint8]

FINE = 3
"""Sub-samples a pixel, each way; odd, so that one of them is its centre."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Pixels of one fit, with a rim for the blur: place and size in the image."""

    x0: int
    y0: int
    width: int
    height: int


@dataclass(frozen=True, slots=True, eq=False)
class PrintSamples:
    """The model at each pixel that is used, and what the image shows there, `(n,)` each.

    Attributes:
        value: model, 0 black to 1 white.
        dx: its gradient along x [1/px].
        dy: and along y [1/px].
        dxx: its second derivative along x [1/px^2].
        dxy: the mixed one [1/px^2].
        dyy: and along y [1/px^2].
        u: place in the print, along its x [m].
        v: along its y [m].
        row: of the pixel in the image [px].
        grey: the image [grey].
        used: which pixels of the window these are `(rows, columns)`.
    """

    value: Array
    dx: Array
    dy: Array
    dxx: Array
    dxy: Array
    dyy: Array
    u: Array
    v: Array
    row: Array
    grey: Array
    used: npt.NDArray[np.bool_]

    @property
    def steep(self) -> Array:
        """Squared slope of the model `(n,)` [1/px^2]."""
        return self.dx**2 + self.dy**2


@dataclass(frozen=True, slots=True, eq=False)
class RenderedPrint:
    """The print rendered for one pose on its fine grid."""

    fine: Image32
    window: Window
    pad: int
    plane_from_pixel: Array
    half: float
    used: float

    def template(self) -> tuple[Image32, npt.NDArray[np.bool_], int, int]:
        """The print at whole pixels `(h, w)`, which of them are of it, and the column and row where they begin."""
        pad, window = self.pad, self.window
        height, width = window.height - 2 * pad, window.width - 2 * pad
        first = FINE * pad + FINE // 2
        seen = self.fine[first : first + FINE * height : FINE, first : first + FINE * width : FINE]
        u, v = self._places(height, width)
        used = (np.abs(u) < self.used) & (np.abs(v) < self.used)
        return np.ascontiguousarray(seen), used, window.x0 + pad, window.y0 + pad

    def _places(self, height: int, width: int) -> tuple[Array, Array]:
        """Where on the print each pixel is `(h, w)` [m]."""
        pad, m = self.pad, self.plane_from_pixel
        x, y = np.arange(pad, pad + width, dtype=np.float64), np.arange(pad, pad + height, dtype=np.float64)[:, None]
        w = m[2, 0] * x + (m[2, 1] * y + m[2, 2])
        return (m[0, 0] * x + (m[0, 1] * y + m[0, 2])) / w, (m[1, 0] * x + (m[1, 1] * y + m[1, 2])) / w

    def samples(self, pixels: Grey) -> PrintSamples:
        """Model and image where the print is; differences are taken between neighbouring sub-samples."""
        pad, window = self.pad, self.window
        height, width = window.height - 2 * pad, window.width - 2 * pad
        first = FINE * pad + FINE // 2

        def shifted(down: int, right: int) -> Image32:
            r, c = first + down, first + right
            return self.fine[r : r + FINE * height : FINE, c : c + FINE * width : FINE]

        centre, left, right = shifted(0, 0), shifted(0, -1), shifted(0, 1)
        up, down = shifted(-1, 0), shifted(1, 0)
        u, v = self._places(height, width)
        used = (np.abs(u) < self.used) & (np.abs(v) < self.used)
        top, start = window.y0 + pad, window.x0 + pad
        grey = pixels[top : top + height, start : start + width]
        return PrintSamples(
            centre[used].astype(np.float64),
            ((right - left) * (FINE / 2))[used].astype(np.float64),
            ((down - up) * (FINE / 2))[used].astype(np.float64),
            ((left + right - 2 * centre) * FINE**2)[used].astype(np.float64),
            ((shifted(1, 1) + shifted(-1, -1) - shifted(1, -1) - shifted(-1, 1)) * (FINE**2 / 4))[used].astype(
                np.float64
            ),
            ((up + down - 2 * centre) * FINE**2)[used].astype(np.float64),
            u[used],
            v[used],
            np.broadcast_to(np.arange(top, top + height, dtype=np.float64)[:, None], used.shape)[used],
            grey[used].astype(np.float64),
            used,
        )
