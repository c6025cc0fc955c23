"""Which exposure and which gain: the shortest exposure in which the cells of a tag stand out of the noise.

Photons decide: contrast over noise grows with the square root of the exposure, whatever the gain. So the exposure
follows from what is wanted of it, and the gain only brings white to a good grey value. A longer exposure smears, a
shorter one drowns the cells in noise. Pure functions; the driver is in `capture`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol, runtime_checkable

import numpy as np

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import EXPOSURE, HALF, LIMITS

ROUNDING: Final = 12**-0.5
"""Deviation of what eight bits round off [grey]: no noise is less."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What a camera is told: exposure [s] and gain, an amplification of which 1 is the least."""

    exposure: float
    gain: float


@dataclass(frozen=True, slots=True)
class Reach:
    """What a camera can be told: exposures [s], the longest at most what motion allows, and the gain over the least."""

    shortest: float
    longest: float
    greatest_gain: float

    def up_to(self, longest: float) -> Reach:
        """The same with exposures of at most `longest` [s]."""
        return replace(self, longest=max(min(self.longest, longest), self.shortest))


@dataclass(frozen=True, slots=True)
class Levels:
    """Of black and white cells of a target, or of the whole image, and the deviation of neighbouring pixels [grey]."""

    black: float
    white: float
    noise: float

    @property
    def contrast(self) -> float:
        """Black to white over the noise."""
        return max(self.white - self.black, 0.0) / self.noise


@runtime_checkable
class Adjustable(Protocol):
    """A source whose camera takes settings from us."""

    @property
    def reach(self) -> Reach | None:
        """What the open camera can be told; none where it takes nothing, or nobody asked for it."""

    def adjust(self, setting: Setting) -> tuple[str, ...]:
        """Tell the camera; returns what it refused this time.

        Raises:
            VisionError: it is gone.
        """


def levels_of(pixels: Grey, corners: Sequence[Array] = (), gamma: float = 1.0) -> Levels:
    """Levels of an image in light: of its largest tag, or of all of it where no tag is seen.

    Args:
        pixels: `(h, w)` uint8.
        corners: of tags `(4, 2)` [px].
        gamma: of the camera's tone curve.
    """
    height, width = pixels.shape
    part, low, high = pixels[::2, ::2], 2.0, 98.0
    quad = max(corners, key=lambda quad: float(np.ptp(quad, axis=0).max()), default=None)
    if quad is not None:
        ends = np.clip([quad.min(axis=0), quad.max(axis=0)], 0, (width - 1, height - 1))
        (x0, y0), (x1, y1) = ends.astype(int).tolist()
        if min(x1 - x0, y1 - y0) >= LIMITS.search.min_window_px:
            part, low, high = pixels[y0 : y1 + 1, x0 : x1 + 1], 15.0, 90.0
    grey = 255.0 * (part.astype(np.float64) / 255.0) ** gamma
    black, white = np.percentile(grey, (low, high))
    # Half of the differences between neighbours cross no edge; their deviation is that of the median of them all.
    steps = np.abs(np.diff(grey, axis=1))
    noise = float(np.percentile(steps, 30)) / 0.545
    return Levels(float(black), float(white), max(noise, ROUNDING))


def next_setting(now: Setting, seen: Levels, reach: Reach) -> Setting:
    """The setting for the coming images; `now` where a change would not be worth it.

    Args:
        now: setting of the image that was seen.
        seen: its levels, in light.
        reach: of the camera.
    """
    brighter = 1.0 / EXPOSURE.step if seen.white >= LIMITS.read.saturated else EXPOSURE.white / max(seen.white, 1.0)
    brightness = now.exposure * now.gain * brighter
    wanted = now.exposure * (EXPOSURE.contrast / max(seen.contrast, 1e-3)) ** 2
    exposure = _within(wanted, now.exposure / EXPOSURE.step, now.exposure * EXPOSURE.step)
    # Too bright at the least gain: shorter. Below half of white at the greatest: longer, as far as motion allows.
    exposure = _within(exposure, HALF * brightness / reach.greatest_gain, brightness)
    exposure = _within(exposure, reach.shortest, reach.longest)
    gain = _within(brightness / exposure, now.gain / EXPOSURE.step, now.gain * EXPOSURE.step)
    gain = _within(gain, 1.0, reach.greatest_gain)
    if abs(exposure / now.exposure - 1.0) < EXPOSURE.same and abs(gain / now.gain - 1.0) < EXPOSURE.same:
        return now
    return Setting(exposure, gain)


def _within(value: float, low: float, high: float) -> float:
    return max(low, min(value, high))


def first_setting(reach: Reach) -> Setting:
    """Before any image: the middle of both ranges, in powers."""
    return Setting(float(np.sqrt(reach.shortest * reach.longest)), float(np.sqrt(reach.greatest_gain)))


@dataclass
class ExposureControl:
    """Chooses the setting of one camera from its images.

    Attributes:
        reach: of the camera.
        setting: that acts now, or soon.
        levels: of the newest image that was looked at.
    """

    reach: Reach
    setting: Setting
    gamma: float = 1.0
    levels: Levels | None = None
    _waited: int = 0

    def image_seen(self, pixels: Grey, corners: Sequence[Array]) -> Setting | None:
        """Take an image and the corners of its tags; the new setting when there is one."""
        self._waited += 1
        if self._waited < EXPOSURE.images:
            return None
        self._waited = 0
        self.levels = levels_of(pixels, corners, self.gamma)
        setting = next_setting(self.setting, self.levels, self.reach)
        if setting is self.setting:
            return None
        self.setting = setting
        return setting
