"""Exposure and gain of a V4L2 camera, by the kernel's own calls; they may be made while another program part streams.

Numbers and structures: linux/videodev2.h and linux/v4l2-controls.h. An exposure of `V4L2_CID_EXPOSURE_ABSOLUTE` counts
100 us. The unit of a gain is the driver's own: its range is taken for 1 to `GREATEST_GAIN`, and what that gets wrong
the next image shows.
"""

from __future__ import annotations

import fcntl
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mkdaemon.vision.camera.exposure import Reach, Setting

QUERY: Final = 0xC0445624
"""VIDIOC_QUERYCTRL of a structure of 68 bytes."""
SET: Final = 0xC008561C
"""VIDIOC_S_CTRL of a structure of 8 bytes."""
EXPOSURE_AUTO, EXPOSURE_ABSOLUTE, EXPOSURE_AUTO_PRIORITY = 0x009A0901, 0x009A0902, 0x009A0903
AUTOGAIN, GAIN = 0x00980912, 0x00980913
MANUAL: Final = 1
"""Of V4L2_CID_EXPOSURE_AUTO."""
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

    Raises:
        OSError: the device cannot be opened.
    """

    def __init__(self, device: Path, call: Call = _call) -> None:
        self._call = call
        self._descriptor = os.open(device, os.O_RDWR | os.O_NONBLOCK)
        self._exposure = self._query(EXPOSURE_ABSOLUTE)
        self._gain = self._query(GAIN)
        if self._exposure is not None:
            for control, value in ((EXPOSURE_AUTO, MANUAL), (EXPOSURE_AUTO_PRIORITY, 0), (AUTOGAIN, 0)):
                if self._query(control) is not None:
                    self._set(control, value)

    @property
    def reach(self) -> Reach | None:
        """What the camera can be told; none where its exposure cannot be set."""
        if self._exposure is None:
            return None
        gain = GREATEST_GAIN if self._gain is not None and self._gain.greatest > self._gain.least else 1.0
        return Reach(max(self._exposure.least, 1) * TICK, self._exposure.greatest * TICK, gain)

    def adjust(self, setting: Setting) -> None:
        """Tell the camera.

        Raises:
            OSError: the device is gone or refuses.
        """
        if self._exposure is not None:
            ticks = round(setting.exposure / TICK)
            self._set(EXPOSURE_ABSOLUTE, min(max(ticks, self._exposure.least, 1), self._exposure.greatest))
        if self._gain is not None:
            span = self._gain.greatest - self._gain.least
            self._set(GAIN, self._gain.least + round(span * (setting.gain - 1.0) / (GREATEST_GAIN - 1.0)))

    def close(self) -> None:
        """Let go of the device; its settings stay."""
        os.close(self._descriptor)

    def _query(self, control: int) -> Range | None:
        content = bytearray(struct.pack("<II32siiiiIII", control, 0, b"", 0, 0, 0, 0, 0, 0, 0))
        try:
            self._call(self._descriptor, QUERY, content)
        except OSError:
            return None
        _, _, _, least, greatest, *_ = struct.unpack("<II32siiiiIII", content)
        return Range(least, greatest)

    def _set(self, control: int, value: int) -> None:
        self._call(self._descriptor, SET, bytearray(struct.pack("<Ii", control, value)))
