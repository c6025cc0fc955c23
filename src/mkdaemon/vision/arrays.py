"""Types of the arrays that the eyes hand on; shape, unit and frame stand where each is used."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]
Bools = npt.NDArray[np.bool_]
