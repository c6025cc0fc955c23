"""The camera that every pose calculation uses: a pinhole with Brown-Conrady distortion, or a fisheye."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mkdaemon.config.base import Section
from mkdaemon.vision.arrays import Array


class Intrinsics(Section):
    """Projection of a camera: RDF axes, pixel centres at integer coordinates.

    Source: OpenCV camera models. `pinhole` has k1, k2, p1, p2, k3 (Brown, Photogrammetric Engineering 37(8), 1971),
    `fisheye` k1 to k4 of the angle from the axis (Kannala and Brandt, PAMI 28(8), 2006).
    """

    width: int = Field(gt=0)
    """Image width the figures hold for [px]."""
    height: int = Field(gt=0)
    """Image height the figures hold for [px]."""
    fx: float = Field(gt=0)
    """Focal length along x [px]."""
    fy: float = Field(gt=0)
    """Focal length along y [px]."""
    cx: float
    """Principal point, x [px]."""
    cy: float
    """Principal point, y [px]."""
    model: Literal["pinhole", "fisheye"] = "pinhole"
    """How the lens bends directions."""
    k1: float = 0.0
    """Radial distortion, second order."""
    k2: float = 0.0
    """Radial distortion, fourth order."""
    p1: float = 0.0
    """Tangential distortion."""
    p2: float = 0.0
    """Tangential distortion."""
    k3: float = 0.0
    """Radial distortion, sixth order."""
    k4: float = 0.0
    """Radial distortion of a fisheye, eighth order."""
    gamma: float = Field(default=1.0, ge=0.5, le=4.0)
    """Tone curve: grey is light to the power 1 / gamma; 1 is a camera that gives light as it is."""
    line_time: float | None = Field(default=None, ge=0, le=1e-3)
    """Between the exposures of neighbouring rows, from the top [s]; 0 is a global shutter. Absent, it is unknown: 0 to
    60 us, in the uncertainty of every pose until images show it."""

    @model_validator(mode="after")
    def _right_coefficients(self) -> Self:
        wrong = ("p1", "p2") if self.model == "fisheye" else ("k4",)
        for name in wrong:
            if getattr(self, name) != 0.0:
                msg = f"{name} has no place in the model {self.model}: leave it out"
                raise ValueError(msg)
        return self

    @property
    def matrix(self) -> Array:
        """Camera matrix `(3, 3)` [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Array:
        """In OpenCV's order: k1, k2, p1, p2, k3 of a pinhole `(5,)`, k1 to k4 of a fisheye `(4,)`."""
        if self.model == "fisheye":
            return np.array([self.k1, self.k2, self.k3, self.k4])
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3])
