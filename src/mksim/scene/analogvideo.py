"""Video of 2010: an interlaced PAL camera, an analog 5.8 GHz link, and a frame grabber that weaves both fields.

The two fields of an image are exposed one after the other, so what moves has combs. The link has a bandwidth, noise
that is alike in neighbouring pixels, and now and then rows in which hardly a signal is left and the grabber loses the
beginning of the line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

Image32 = npt.NDArray[np.float32]

FIELD_TIME: Final = 1.0 / 60.0
"""Between the fields of an image, which come 30 times a second here [s]."""
BAND_PX: Final = 0.85
"""Deviation of what 5 MHz leave of a point, of 640 pixels in the 52 us of a line [px]."""
NOISE_PX: Final = 0.7
"""The same of the noise, which passes the receiver's filter alone [px]."""
PEAKING: Final = 0.4
"""Share of the difference to a blurred line that the camera adds before it sends: its aperture correction; chosen."""
PEAKED_PX: Final = 1.5
BANDS: Final = 3
"""Most bands of noise in an image."""
BAND_ROWS: Final = (6, 40)
"""Rows of a band; chosen."""
BAND_NOISE: Final = 45.0
"""Deviation of the noise in it [grey]; chosen."""
TORN_PX: Final = 5.0
"""Deviation of the shift of its rows [px]; chosen."""


@dataclass(frozen=True, slots=True)
class AnalogVideo:
    """An analog link.

    Attributes:
        noise: deviation of a grey value [grey].
        disturbed: share of the images with bands of noise.
    """

    noise: float
    disturbed: float


def weave(first: Image32, second: Image32) -> Image32:
    """One image `(h, w)` of two fields: even rows of the first, odd rows of the second."""
    woven = first.copy()
    woven[1::2] = second[1::2]
    return woven


def through_air(grey: Image32, video: AnalogVideo, rng: np.random.Generator) -> Image32:
    """Grey values `(h, w)` behind camera, link and grabber."""
    soft = cv2.GaussianBlur(grey, (0, 0), sigmaX=PEAKED_PX, sigmaY=1e-3)
    sent = cv2.GaussianBlur(grey + np.float32(PEAKING) * (grey - soft), (0, 0), sigmaX=BAND_PX, sigmaY=1e-3)
    deviation = np.full(len(grey), video.noise, dtype=np.float32)
    shift = np.zeros(len(grey))
    if rng.random() < video.disturbed:
        for _ in range(int(rng.integers(1, BANDS + 1))):
            start = int(rng.integers(0, len(grey)))
            rows = slice(start, start + int(rng.integers(*BAND_ROWS)))
            deviation[rows] = BAND_NOISE
            shift[rows] = rng.normal(0.0, TORN_PX, len(shift[rows]))
    noise = cv2.GaussianBlur(rng.standard_normal(grey.shape, dtype=np.float32), (0, 0), sigmaX=NOISE_PX, sigmaY=1e-3)
    received = np.asarray(sent, np.float32) + noise * (deviation / np.float32(noise.std()))[:, None]
    for row in np.flatnonzero(np.rint(shift)):
        received[row] = np.roll(received[row], int(np.rint(shift[row])))
    return np.asarray(received, dtype=np.float32)
