"""The line time of a rolling shutter from lamps that flicker.

Rows exposed one after the other see the light rise and fall: bands across the image, whose distance is a period of the
flicker over the line time. What stands still goes out in the mean of the images.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Grey

LEAST_IMAGES: Final = 8
LEAST_BANDS: Final = 1.5
"""Periods of the flicker in an image from which their distance can be told."""
MOST_PER_ROW: Final = 0.1
"""Periods a row at most: a readout of one period in ten rows is none."""
FINER: Final = 20
"""Frequencies tried between those of a Fourier transform."""
CLEAR: Final = 6.0
"""Power of the bands over the median power from which they are bands."""
EXPOSURE_HELP: Final = "show a plain wall under a lamp on mains, exposure below 5 ms, nothing moving"


def line_time_of(images: Sequence[Grey], flicker_hz: float) -> tuple[float, float]:
    """Line time and its deviation [s].

    Args:
        images: of one scene at rest under the lamp `(h, w)`, at least eight.
        flicker_hz: twice the mains frequency: 100 or 120 Hz.

    Raises:
        VisionError: too few images, or no bands.
    """
    if len(images) < LEAST_IMAGES:
        msg = f"{len(images)} images, at least {LEAST_IMAGES} are needed"
        raise VisionError(msg)
    rows = np.log(np.array([image.mean(axis=1) for image in images]) + 1.0)
    bands = rows - rows.mean(axis=0)
    bands -= bands.mean(axis=1, keepdims=True)
    height = bands.shape[1]
    tried = np.fft.rfftfreq(FINER * height)
    is_band = (tried * height >= LEAST_BANDS) & (tried < MOST_PER_ROW)
    tried = tried[is_band]
    each = np.abs(np.fft.rfft(bands * np.hanning(height), FINER * height)[:, is_band]) ** 2
    power = each.sum(axis=0)
    best = int(power.argmax())
    if best in (0, len(tried) - 1) or power[best] < CLEAR * float(np.median(power)):
        msg = f"no bands of a flickering lamp in the images: {EXPOSURE_HELP}"
        raise VisionError(msg)
    parts = np.array_split(each, min(len(images) // 2, LEAST_IMAGES))
    found = [tried[part.sum(axis=0).argmax()] for part in parts]
    sd = float(np.std(found)) / np.sqrt(len(found)) + 0.5 / (FINER * height)
    return float(tried[best]) / flicker_hz, sd / flicker_hz
