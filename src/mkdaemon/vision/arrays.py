"""Types of the arrays of vision, and estimates; shape, unit and frame stand where each is used."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]
Bools = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.intp]
Array32 = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class UnknownsEstimate:
    """Estimate of some unknowns.

    Attributes:
        mean: of each `(k,)`.
        covariance: `(k, k)`.
    """

    mean: Array
    covariance: Array

    @cached_property
    def information(self) -> Array:
        """Inverse of the covariance `(k, k)`."""
        return np.asarray(np.linalg.inv(self.covariance), np.float64)
