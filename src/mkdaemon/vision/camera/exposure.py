"""Exposure and gain: the shortest exposure in which the cells of a tag stand out of the noise, and how V4L2 sets it.

Contrast over noise grows with the square root of the exposure, whatever the gain, which only brings white to a good
grey value. Numbers and structures of V4L2: linux/videodev2.h and linux/v4l2-controls.h. The driver's own range of a
gain is taken for 1 to `GREATEST_GAIN`; what that gets wrong the next image shows.
"""

from __future__ import annotations

import errno
import fcntl
import math
import os
import struct
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.limits import EXPOSURE, HALF, LIMITS

ROUNDING: Final = 12**-0.5
"""Deviation of what eight bits round off [grey]: no noise is less."""
QUERY: Final = 0xC0445624
"""VIDIOC_QUERYCTRL of a structure of 68 bytes."""
SET: Final = 0xC008561C
"""VIDIOC_S_CTRL of a structure of 8 bytes."""
MANUAL, AUTO = 1, 3
"""Of V4L2_CID_EXPOSURE_AUTO: manual and aperture priority."""
QUERIED: Final = "=II32siiiiIII"
"""struct v4l2_queryctrl: id, type, name, minimum, maximum, step, default_value, flags, reserved[2]."""
UNSETTABLE: Final = 0x0001 | 0x0004
"""V4L2_CTRL_FLAG_DISABLED, V4L2_CTRL_FLAG_READ_ONLY."""
GONE: Final = frozenset({errno.ENODEV, errno.ENXIO})
"""What the kernel says of a device that was unplugged while it is open; other errors are a control's, images go on."""
TICK: Final = 100e-6
"""Unit of V4L2_CID_EXPOSURE_ABSOLUTE [s]."""
GREATEST_GAIN: Final = 16.0
"""Analogue gain of the OV9281, registers 0x10 to 0xff (Linux, drivers/media/i2c/ov9282.c)."""


class Control(IntEnum):
    """A number of V4L2: V4L2_CID_EXPOSURE_AUTO and so on."""

    AUTOGAIN = 0x00980912
    GAIN = 0x00980913
    EXPOSURE_AUTO = 0x009A0901
    EXPOSURE_ABSOLUTE = 0x009A0902


class Setting(NamedTuple):
    """Settings of a camera: exposure [s] and gain, an amplification of which 1 is the least."""

    exposure: float
    gain: float


class Reach(NamedTuple):
    """Range of settings: exposures [s], the longest at most what motion allows, and the gain over the least."""

    shortest: float
    longest: float
    greatest_gain: float


class Levels(NamedTuple):
    """Of black and white cells of a target, or of the whole image, and the deviation of neighbouring pixels [grey]."""

    black: float
    white: float
    noise: float

    @property
    def contrast(self) -> float:
        """Black to white over the noise."""
        return max(self.white - self.black, 0.0) / self.noise


def levels_of(pixels: Grey, corners: Sequence[Array] = (), gamma: float = 1.0) -> Levels:
    """Levels in light of an image `(h, w)` of a tone curve: of its largest tag by corners `(4, 2)` [px], or of all."""
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
    noise = float(np.percentile(np.abs(np.diff(grey, axis=1)), 30)) / 0.545
    return Levels(float(black), float(white), max(noise, ROUNDING))


def next_setting(now: Setting, seen: Levels, reach: Reach) -> Setting:
    """The setting after an image that was taken with `now`; `now` itself where a change would not be worth it."""
    brighter = 1.0 / EXPOSURE.step if seen.white >= LIMITS.read.saturated else EXPOSURE.white / max(seen.white, 1.0)
    # Grey values are in proportion to exposure times gain.
    brightness = now.exposure * now.gain * brighter
    # Contrast over photon noise grows with the square root of the light: it takes its square in exposure.
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


class ExposureControl:
    """Chooses the setting of one camera from its images.

    Attributes:
        setting: that acts now, or soon; at first the middle of both ranges, in powers.
        levels: of the newest image that was looked at.
    """

    def __init__(self, reach: Reach) -> None:
        self.reach = reach
        self.setting = Setting(math.sqrt(reach.shortest * reach.longest), math.sqrt(reach.greatest_gain))
        self.levels: Levels | None = None
        self._images = 0

    def image_seen(self, pixels: Grey, corners: Sequence[Array], gamma: float = 1.0) -> None:
        """Take an image; every few images the setting follows from one. See `levels_of`."""
        self._images += 1
        if self._images % EXPOSURE.images == 0:
            self.levels = levels_of(pixels, corners, gamma)
            self.setting = next_setting(self.setting, self.levels, self.reach)


class V4l2Controls:
    """Exposure and gain of one device, which may be set while another part of the program streams from it.

    Attributes:
        reach: range of settings, exposures up to `longest` [s]; none where they cannot be set.
        refused: what the driver did not let us take over from it.

    Raises:
        VisionError: the device is gone, or cannot be opened.
    """

    def __init__(self, device: Path, longest: float) -> None:
        self._device = device
        self.refused: tuple[str, ...] = ()
        self.reach: Reach | None = None
        try:
            self._descriptor = os.open(device, os.O_RDWR | os.O_NONBLOCK)
        except OSError as error:
            msg = f"{device} cannot be opened a second time, to set its exposure: {error.strerror}"
            raise VisionError(msg) from None
        try:
            exposure = self._take_over(Control.EXPOSURE_ABSOLUTE, Control.EXPOSURE_AUTO, MANUAL)
            if exposure is None:
                return
            self._gain = self._take_over(Control.GAIN, Control.AUTOGAIN, 0)
        except VisionError:
            self.close()
            raise
        shortest = max(exposure[0], 1) * TICK
        longest = max(min(exposure[1] * TICK, longest), shortest)
        self.reach = Reach(shortest, longest, 1.0 if self._gain is None else GREATEST_GAIN)

    def adjust(self, setting: Setting) -> tuple[str, ...]:
        """Tell the camera; returns what it refused this time.

        Raises:
            VisionError: the device is gone.
        """
        if self.reach is None:
            return ()
        exposure = _within(setting.exposure, self.reach.shortest, self.reach.longest)
        refused = self._set(Control.EXPOSURE_ABSOLUTE, round(exposure / TICK))
        if self._gain is not None:
            refused += self._set(Control.GAIN, round(float(np.interp(setting.gain, (1.0, GREATEST_GAIN), self._gain))))
        return refused

    def close(self) -> None:
        """Close the device; its settings stay."""
        os.close(self._descriptor)

    def _take_over(self, control: Control, automatic: Control, off: int) -> tuple[int, int] | None:
        """Range of a control that is ours now [driver's unit]; None where there is none, or the camera keeps it."""
        found = self._query(control)
        if found is None or self._query(automatic) is None:
            return found
        kept = self._set(automatic, off)
        self.refused += kept
        return None if kept else found

    def _query(self, control: Control) -> tuple[int, int] | None:
        """Range of a control that can be set; a busy or inactive one counts, as it may become free."""
        content = bytearray(struct.pack(QUERIED, control, 0, b"", 0, 0, 0, 0, 0, 0, 0))
        if self._ask(QUERY, content):
            return None
        _, _, _, least, greatest, _, _, flags, *_ = struct.unpack(QUERIED, content)
        return None if flags & UNSETTABLE or least >= greatest else (least, greatest)

    def _set(self, control: Control, value: int) -> tuple[str, ...]:
        """Set a control; what and why, where the driver refuses."""
        fault = self._ask(SET, bytearray(struct.pack("=Ii", control, value)))
        return (f"{control.name.lower()}={value}: the driver says {fault}",) if fault else ()

    def _ask(self, request: int, content: bytearray) -> str:
        """Ask the kernel, which answers in `content`; why it refuses, empty where it does not."""
        try:
            fcntl.ioctl(self._descriptor, request, content)
        except OSError as error:
            if error.errno in GONE:
                msg = f"{self._device} is gone ({error.strerror}): plug it in"
                raise VisionError(msg) from None
            return str(error.strerror)
        return ""
