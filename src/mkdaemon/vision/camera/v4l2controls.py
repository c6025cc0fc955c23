"""Exposure and gain of a V4L2 camera, by the kernel's own calls; they may be made while another program part streams.

Numbers and structures: linux/videodev2.h and linux/v4l2-controls.h. An exposure of `V4L2_CID_EXPOSURE_ABSOLUTE` counts
100 us. The unit of a gain is the driver's own: its range is taken for 1 to `GREATEST_GAIN`, and what that gets wrong
the next image shows.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mkdaemon.errors import VisionError
from mkdaemon.vision.camera.exposure import Reach, Setting

QUERY: Final = 0xC0445624
"""VIDIOC_QUERYCTRL of a structure of 68 bytes."""
SET: Final = 0xC008561C
"""VIDIOC_S_CTRL of a structure of 8 bytes."""
EXPOSURE_AUTO, EXPOSURE_ABSOLUTE, EXPOSURE_AUTO_PRIORITY = 0x009A0901, 0x009A0902, 0x009A0903
AUTOGAIN, GAIN = 0x00980912, 0x00980913
NAMES: Final = {
    EXPOSURE_AUTO: "exposure_auto",
    EXPOSURE_ABSOLUTE: "exposure_absolute",
    EXPOSURE_AUTO_PRIORITY: "exposure_auto_priority",
    AUTOGAIN: "autogain",
    GAIN: "gain",
}
MANUAL: Final = 1
"""Of V4L2_CID_EXPOSURE_AUTO."""
QUERIED: Final = "=II32siiiiIII"
"""struct v4l2_queryctrl: id, type, name, minimum, maximum, step, default_value, flags, reserved[2]."""
UNSETTABLE: Final = 0x0001 | 0x0004
"""V4L2_CTRL_FLAG_DISABLED, V4L2_CTRL_FLAG_READ_ONLY."""
GONE: Final = frozenset({errno.ENODEV, errno.ENXIO})
"""What the kernel says of a device that was unplugged while it is open. EBUSY, EACCES, EINVAL, ERANGE and EIO are a
control's: images go on."""
TICK: Final = 100e-6
GREATEST_GAIN: Final = 16.0
"""Analogue gain of the OV9281, registers 0x10 to 0xff (Linux, drivers/media/i2c/ov9282.c)."""

Call = Callable[[int, int, bytearray], int]


def _call(descriptor: int, request: int, content: bytearray) -> int:
    return int(fcntl.ioctl(descriptor, request, content))


@dataclass(frozen=True, slots=True)
class Range:
    """Of one control, in the driver's unit."""

    least: int
    greatest: int


class V4l2Controls:
    """Exposure and gain of one device.

    Args:
        device: `/dev/video0`.
        call: the kernel's ioctl.

    Attributes:
        refused: what the driver did not let us take over from it.

    Raises:
        VisionError: the device is gone, or cannot be opened.
    """

    def __init__(self, device: Path, call: Call = _call) -> None:
        self._device, self._call = device, call
        try:
            self._descriptor = os.open(device, os.O_RDWR | os.O_NONBLOCK)
        except OSError as error:
            msg = f"{device} cannot be opened a second time, to set its exposure: {error.strerror}"
            raise VisionError(msg) from None
        try:
            self.refused = self._take_over()
        except VisionError:
            self.close()
            raise

    @property
    def reach(self) -> Reach | None:
        """What the camera can be told; none where its exposure cannot be set."""
        if self._exposure is None:
            return None
        gain = GREATEST_GAIN if self._gain is not None and self._gain.greatest > self._gain.least else 1.0
        return Reach(max(self._exposure.least, 1) * TICK, self._exposure.greatest * TICK, gain)

    def adjust(self, setting: Setting) -> tuple[str, ...]:
        """Tell the camera; returns what it refused this time.

        Raises:
            VisionError: the device is gone.
        """
        refused: list[str] = []
        if self._exposure is not None:
            ticks = round(setting.exposure / TICK)
            refused += self._set(EXPOSURE_ABSOLUTE, min(max(ticks, self._exposure.least, 1), self._exposure.greatest))
        if self._gain is not None:
            span = self._gain.greatest - self._gain.least
            refused += self._set(GAIN, self._gain.least + round(span * (setting.gain - 1.0) / (GREATEST_GAIN - 1.0)))
        return tuple(refused)

    def close(self) -> None:
        """Let go of the device; its settings stay."""
        os.close(self._descriptor)

    def _take_over(self) -> tuple[str, ...]:
        """Switch the camera's own exposure and gain off; what it keeps for itself is not ours to set."""
        self._exposure, self._gain = self._query(EXPOSURE_ABSOLUTE), self._query(GAIN)
        if self._exposure is None:
            return ()
        stays_auto = self._switch_off(EXPOSURE_AUTO, MANUAL)
        if stays_auto:
            self._exposure = self._gain = None
            return stays_auto
        own_gain = self._switch_off(AUTOGAIN, 0)
        if own_gain:
            self._gain = None
        return (*self._switch_off(EXPOSURE_AUTO_PRIORITY, 0), *own_gain)

    def _switch_off(self, control: int, value: int) -> tuple[str, ...]:
        return self._set(control, value) if self._query(control) is not None else ()

    def _query(self, control: int) -> Range | None:
        """Range of a control that can be set; a busy or inactive one counts, as it may become free."""
        content = bytearray(struct.pack(QUERIED, control, 0, b"", 0, 0, 0, 0, 0, 0, 0))
        try:
            self._call(self._descriptor, QUERY, content)
        except OSError as error:
            self._raise_if_gone(error)
            return None
        _, _, _, least, greatest, _, _, flags, *_ = struct.unpack(QUERIED, content)
        return None if flags & UNSETTABLE else Range(least, greatest)

    def _set(self, control: int, value: int) -> tuple[str, ...]:
        """Set a control; what and why, where the driver refuses."""
        try:
            self._call(self._descriptor, SET, bytearray(struct.pack("=Ii", control, value)))
        except OSError as error:
            self._raise_if_gone(error)
            return (f"{NAMES[control]}={value}: the driver says {error.strerror}",)
        return ()

    def _raise_if_gone(self, error: OSError) -> None:
        if error.errno in GONE:
            msg = f"{self._device} is gone ({error.strerror}): plug it in"
            raise VisionError(msg) from None
