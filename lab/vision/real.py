"""Cameras as they are: tone curve, colour mosaic, sharpening, JPEG, rolling shutter, vibration, little light."""

from __future__ import annotations

from math import radians
from typing import Final

from lab.vision.flight import VGA, Device
from mksim.scene.light import LightConditions
from mksim.scene.processing import Processing

READOUT: Final = 0.030
"""Of all rows of an image [s]: a webcam at 30 images a second."""
VIBRATION: Final = radians(1.0)
RESPONSE: Final = 0.03
"""Of a multirotor's frame to what shakes it [s]."""
TONE: Final = LightConditions(processing=Processing(gamma=2.2))
WEBCAM: Final = LightConditions(
    processing=Processing(mosaic=True, denoise=6.0, gamma=2.2, sharpening=0.8), jpeg_quality=85
)
DARK: Final = LightConditions(exposure=0.15, noise_sd=2.5, processing=Processing(mosaic=True, denoise=4.0, gamma=2.2))
LINE_TIME: Final = READOUT / VGA.height
DEVICES: Final = {
    "ideal": Device(response=RESPONSE),
    "gamma": Device(TONE, response=RESPONSE),
    "low_light": Device(DARK, exposure_time=0.008, response=RESPONSE),
    "webcam": Device(WEBCAM, response=RESPONSE),
    "rolling": Device(line_time=LINE_TIME, vibration=VIBRATION, response=RESPONSE),
    "webcam_rolling": Device(WEBCAM, line_time=LINE_TIME, vibration=VIBRATION, response=RESPONSE),
}
"""Cameras by name."""
