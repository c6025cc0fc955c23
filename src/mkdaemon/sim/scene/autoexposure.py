"""What a camera does to its own exposure and colours from image to image when nobody tells it otherwise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class AutoSettings:
    """A camera's automatics.

    Attributes:
        wanted: mean grey value it seeks over the whole image; 18 % of the light under gamma 2.2 is 117 of 255.
        share: part of the way it goes from one image to the next, in logarithms of brightness: the `speed` of
            libcamera's agc for the Raspberry Pi, 0.2. UVC cameras do not tell theirs.
        delay: images until a setting acts: two, as the sensors' drivers in libcamera (IMX219, IMX296, OV9281).
        reach: greatest change of brightness in either direction.
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


NEUTRAL: Final = (1.0, 1.0)


class AutoWhiteBalance:
    """Follows the colour of the light: gains of red and blue that make the scene grey on average.

    Args:
        share: part of the way from one image to the next; libcamera's awb for the Raspberry Pi has a `speed` of 0.05.

    Attributes:
        gains: of red and blue that act in the next image.
    """

    def __init__(self, share: float = 0.05) -> None:
        self._share = share
        self.gains = NEUTRAL

    def cast(self, light: tuple[float, float]) -> tuple[float, float]:
        """What is left of the colour of the light: red and blue over green in the image of a grey scene.

        Args:
            light: red and blue over green in the light; shade under a blue sky is about (0.8, 1.3) beside the sun.
        """
        return light[0] * self.gains[0], light[1] * self.gains[1]

    def image_seen(self, light: tuple[float, float]) -> None:
        """Take an image under a light and come nearer to its inverse."""
        red, blue = (
            gain * (1.0 / (gain * colour)) ** self._share for gain, colour in zip(self.gains, light, strict=True)
        )
        self.gains = (red, blue)
