"""What every state of a fit to grey values asks for anew: light, and what a motion lacks, in which images are linear.

Neither is carried from step to step. A state is as good as its best light and its best motion together: with the light
told first, and then what the motion lacks by what the light had left, costs rose along steps that led to the place, and
fits ended beside it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.edgestep import MAD, damped
from mkdaemon.vision.pose.pose import median

Array = npt.NDArray[np.float64]


def asked_anew(residual: Array, columns: Array, spread: Array, outlier: float) -> Array:
    """The unknowns `(k,)` that explain residuals best, all at once.

    Args:
        residual: of each pixel `(n,)` [grey].
        columns: derivative by each unknown `(k, n)`.
        spread: deviation of each that is expected `(k,)`; infinite where anything is.
        outlier: deviations from which a pixel loses weight.
    """
    variance = max(MAD * median(np.abs(residual)), 1.0) ** 2
    weighted = columns / np.maximum(residual**2 / (outlier**2 * variance), 1.0)
    normal = damped(weighted @ columns.T + np.diag(variance / spread**2))
    return np.asarray(np.linalg.solve(normal, weighted @ residual), np.float64)
