"""What the processor of a camera makes of the light its sensor saw: colour mosaic, denoising, tone curve, sharpening.

A cheap webcam does all of it; the default does nothing, as a camera that gives raw grey values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

Image32 = npt.NDArray[np.float32]

FULL: Final = np.float32(255.0)
SHARPENED_PX: Final = 1.0
"""Deviation of the blur that sharpening takes off [px]."""
DENOISED_PX: Final = 2.0
"""Reach of the denoising, deviation [px]."""
MOSAIC_STEPS: Final = np.float32(200.0)
"""Steps of the sensor per grey value while its mosaic is filled in: 16 bits."""


@dataclass(frozen=True, slots=True)
class Processing:
    """What is done to the light of one image, in this order.

    Attributes:
        mosaic: the sensor has colour filters (Bayer) whose gaps are filled in.
        denoise: grey values of neighbours that differ by less are averaged, deviation [grey]; 0 does not.
        gamma: grey is light to the power 1 / gamma; 2.2 is about the curve of sRGB and of BT.709.
        sharpening: share of the difference from a blurred image that is added; chosen for each kind.
    """

    mosaic: bool = False
    denoise: float = 0.0
    gamma: float = 1.0
    sharpening: float = 0.0

    def apply(self, light: Image32) -> Image32:
        """Grey values `(h, w)`, not yet rounded, of light `(h, w)` from 0 to 255, in which noise is already."""
        if self.mosaic:
            light = _fill_mosaic(light)
        if self.denoise > 0.0:
            light = np.asarray(cv2.bilateralFilter(light, 0, self.denoise, DENOISED_PX), dtype=np.float32)
        if self.gamma != 1.0:
            light = FULL * (np.clip(light, 0.0, FULL) / FULL) ** np.float32(1.0 / self.gamma)
        if self.sharpening > 0.0:
            blurred = np.asarray(cv2.GaussianBlur(light, (0, 0), SHARPENED_PX), dtype=np.float32)
            light = light + np.float32(self.sharpening) * (light - blurred)
        return light


NO_PROCESSING: Final = Processing()
"""A camera that gives raw grey values."""


def _fill_mosaic(light: Image32) -> Image32:
    """Luminance of a grey scene behind a colour mosaic: each pixel saw one colour, the others come from neighbours."""
    raw = np.clip(light * MOSAIC_STEPS, 0.0, 65535.0).astype(np.uint16)
    colours = cv2.cvtColor(raw, cv2.COLOR_BayerBG2BGR)
    return np.asarray(cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY), dtype=np.float32) / MOSAIC_STEPS
