"""Signs that a camera does not show what it should."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.pose.pose import Pose

Grey = npt.NDArray[np.uint8]

DARK_BELOW = 25
"""The brightest percent of a usable image is above this [grey]."""
BLOWN_SHARE = 0.5
"""Share of saturated pixels in an over-exposed image."""
FROZEN_AFTER = 3
"""Identical images in a row; the noise of a living sensor never repeats."""
BLURRED_PX = 5.0
"""Width of an edge from which motion or focus is at fault [px]."""
DRIFT_PX = 0.15
"""Edge residual that a right calibration does not leave behind [px]."""
DRIFT_FITS = 30


class ImageHealth:
    """Watches the images of one camera."""

    def __init__(self, width: int | None, height: int | None) -> None:
        self._shape = (height, width) if width is not None and height is not None else None
        self._last: Grey | None = None
        self._repeats = 0
        self._residuals: deque[float] = deque(maxlen=DRIFT_FITS)
        self._blur: deque[float] = deque(maxlen=5)

    def check(self, pixels: Grey) -> list[str]:
        """Alarms of one image `(h, w)` uint8."""
        if pixels.ndim != 2 or pixels.size == 0 or (self._shape is not None and pixels.shape != self._shape):
            return ["wrong_size"]
        alarms: list[str] = []
        thin = pixels[::8, ::8]
        if float(np.percentile(thin, 99)) < DARK_BELOW:
            alarms.append("dark")
        if float((thin >= 250).mean()) > BLOWN_SHARE:
            alarms.append("blown")
        if self._is_frozen(np.ascontiguousarray(pixels[::3, ::5])):
            alarms.append("frozen")
        if len(self._blur) == self._blur.maxlen and float(np.median(self._blur)) > BLURRED_PX:
            alarms.append("blurred")
        if len(self._residuals) == DRIFT_FITS and float(np.median(self._residuals)) > DRIFT_PX:
            alarms.append("residual_drift")
        return alarms

    def note(self, pose: Pose, side_px: float) -> None:
        """Remember the residual and sharpness of an accepted fit; small tags say nothing about calibration."""
        if pose.source != "edges" or side_px < 60.0:
            return
        if pose.blur_px is not None:
            self._blur.append(pose.blur_px)
        if pose.blur_px is None or pose.blur_px < 3.0:
            self._residuals.append(pose.rms_px)

    def _is_frozen(self, thin: Grey) -> bool:
        # A black or saturated image repeats without being frozen; those have their own alarms.
        same = self._last is not None and bool(np.array_equal(self._last, thin)) and int(thin.min()) < int(thin.max())
        self._repeats = self._repeats + 1 if same else 0
        self._last = thin
        return self._repeats >= FROZEN_AFTER
