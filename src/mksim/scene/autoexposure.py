"""Automatic exposure of a camera, from image to image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class AutoSettings:
    """A camera's automatics.

    Attributes:
        wanted: mean grey value it seeks over the whole image; 18 % of the light under gamma 2.2 is 117 of 255.
        share: part of the way it goes from one image to the next, in logarithms of brightness: 0.2, the default
            `speed` of libcamera's agc for the Raspberry Pi (src/ipa/rpi/controller/rpi/agc_channel.cpp). Taken for
            webcams too, whose own was not found.
        delay: images until a setting acts: 2, `exposureDelay` of IMX219, IMX296, AR0144 and OV9281 in libcamera
            (src/libcamera/sensor/camera_sensor_properties.cpp). Taken for webcams too.
        reach: greatest change of brightness in either direction; chosen.
    """

    wanted: float = 117.0
    share: float = 0.2
    delay: int = 2
    reach: float = 16.0


class AutoExposure:
    """Seeks a mean grey value, as the processor of a camera does: bright ground makes a dark target, and the reverse.

    Args:
        settings: where to and how fast.
        brightness: to begin with.

    Attributes:
        brightness: factor on the light that acts in the next image.
    """

    def __init__(self, settings: AutoSettings, brightness: float = 1.0) -> None:
        self._settings = settings
        self._coming = [brightness] * settings.delay
        self._decided = brightness
        self.brightness = brightness

    def image_seen(self, pixels: npt.NDArray[np.uint8], gamma: float = 1.0) -> None:
        """Take an image `(h, w)` that was made with the present `brightness`.

        Args:
            pixels: the image.
            gamma: of the tone curve between light and grey value.
        """
        cfg = self._settings
        mean = max(float(pixels[::8, ::8].mean()), 1.0)
        target = self.brightness * (cfg.wanted / mean) ** gamma
        decided = self._decided * (target / self._decided) ** cfg.share
        self._decided = float(np.clip(decided, 1.0 / cfg.reach, cfg.reach))
        self._coming.append(self._decided)
        self.brightness = self._coming.pop(0)
