"""Signs that a camera does not show what it should."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.edgefind import HALF_WIDTH
from mkdaemon.vision.pose.pose import Pose

DRIFT_FITS, BLUR_FITS = 30, 5
"""Residuals and widths of edges whose median counts."""
BRIGHTEST = 0.99
"""Quantile of the grey values of an image that tells whether it has light."""


class ImageHealth:
    """Watches the images of one camera."""

    def __init__(self, width: int | None, height: int | None) -> None:
        self._shape = (height, width) if width is not None and height is not None else None
        self._last: Grey | None = None
        self._repeats = 0
        self._residuals: deque[float] = deque(maxlen=DRIFT_FITS)
        self._blur: deque[float] = deque(maxlen=BLUR_FITS)

    def check(self, pixels: npt.NDArray[Any]) -> list[Alarm]:
        """Alarms of one image, which ought to be `(h, w)` uint8; of another kind or size, that alone."""
        if pixels.dtype != np.uint8:
            return [Alarm.WRONG_KIND]
        if pixels.ndim != 2 or pixels.size == 0 or (self._shape is not None and pixels.shape != self._shape):
            return [Alarm.WRONG_SIZE]
        limits, thin = LIMITS.health, pixels[::8, ::8]
        signs = {
            Alarm.DARK: np.count_nonzero(thin < limits.dark_grey) > BRIGHTEST * thin.size,
            Alarm.BLOWN: np.count_nonzero(thin >= LIMITS.read.saturated) > HALF * thin.size,
            Alarm.FROZEN: self._is_frozen(np.ascontiguousarray(pixels[::3, ::5])),
            Alarm.BLURRED: len(self._blur) == BLUR_FITS and median(self._blur) > LIMITS.blur.alarm_px,
            Alarm.RESIDUAL_DRIFT: len(self._residuals) == DRIFT_FITS and median(self._residuals) > limits.drift_px,
        }
        return [alarm for alarm, is_seen in signs.items() if is_seen]

    def note(self, pose: Pose, side_px: float) -> None:
        """Remember the sharpness and, of edges, the residual of an accepted fit; small tags tell nothing."""
        if side_px < LIMITS.health.large_tag_px:
            return
        is_of_edges = pose.source == "edges"
        if pose.blur_px is not None:
            self._blur.append(pose.blur_px if is_of_edges else pose.blur_px * HALF_WIDTH)
        if is_of_edges and (pose.blur_px is None or pose.blur_px < LIMITS.blur.smeared_px):
            self._residuals.append(pose.rms_px)

    def _is_frozen(self, thin: Grey) -> bool:
        # A black or saturated image repeats without being frozen; those have their own alarms.
        same = self._last is not None and bool(np.array_equal(self._last, thin)) and int(thin.min()) < int(thin.max())
        self._repeats = self._repeats + 1 if same else 0
        self._last = thin
        return self._repeats >= LIMITS.health.frozen_images
