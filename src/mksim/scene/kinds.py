"""Cameras people fly, beside their lens: shutter, processor, noise, automatics. One table, by name.

What was read in a driver or a manufacturer's documentation is cited beside it. Everything else is chosen, measured on
no specimen: vignetting, read noise, the processor's mosaic, denoising, tone curve and sharpening, JPEG quality and
fringe, so that the kinds go from a raw machine camera to a cheap webcam.

Noise: with a full well of N electrons photons have a variance of 255 / N grey values for each grey value, at gain 1.
4300 electrons are the OV5647's (Raspberry Pi documentation, hardware/camera/README.md, camera 1: "4.3 Ke-"); they
stand for all sensors with pixels below 2 um, whose own were not found. 10,000 for pixels of 3.45 um and 6500 for
3 um are chosen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from mksim.config import KindName
from mksim.scene.analogvideo import AnalogVideo
from mksim.scene.autoexposure import AutoSettings
from mksim.scene.light import LightConditions
from mksim.scene.processing import Processing


@dataclass(frozen=True, slots=True)
class CameraKind:
    """What a camera does beside its lens.

    Attributes:
        conditions: noise, lens faults and processing in fair weather.
        line_time: between neighbouring rows at 640 x 480 [s]; 0 is a global shutter.
        auto: its automatic exposure; None without an image processor.
    """

    conditions: LightConditions
    line_time: float = 0.0
    auto: AutoSettings | None = None


def _noise(full_well: float) -> float:
    """Variance of a grey value for each grey value; see the module."""
    return 255.0 / full_well


CAMERA_KINDS: Final[dict[KindName, CameraKind]] = {
    # Noise and vignetting of the configured light alone.
    "ideal": CameraKind(LightConditions(noise_sd=0.0, vignetting=0.0)),
    # Logitech C270: motion JPEG of 640 x 480 (LogitechC270.h of va009039's USB host, os.mbed.com), a plastic lens (one
    # opened: theshuttergoesclick.blogspot.com, January 2021). No read-out was found. Chosen: 30 ms, nearly the whole of
    # 33 ms, the worst for a pose; `mkdaemon calibrate shutter` measures it.
    "c270": CameraKind(
        LightConditions(
            vignetting=0.35,
            noise_sd=2.0,
            shot_gain=_noise(4300),
            processing=Processing(mosaic=True, denoise=6.0, gamma=2.2, sharpening=0.8),
            jpeg_quality=85,
            fringe_px=2.0,
        ),
        line_time=30e-3 / 480,
        auto=AutoSettings(),
    ),
    # Logitech C920: motion JPEG up to 1920 x 1080, advertised with 78 degrees across the diagonal
    # (wimsworld.wordpress.com, "Logitech C920 Angle of View", 2013). No read-out was found. Chosen: 25 ms.
    "c920": CameraKind(
        LightConditions(
            vignetting=0.25,
            noise_sd=1.5,
            shot_gain=_noise(4300),
            processing=Processing(mosaic=True, denoise=5.0, gamma=2.2, sharpening=0.6),
            jpeg_quality=90,
            fringe_px=1.0,
        ),
        line_time=25e-3 / 480,
        auto=AutoSettings(),
    ),
    # Raspberry Pi camera 2, Sony IMX219: pixels of 1.12 um, f/2.0 (documentation of Raspberry Pi, hardware
    # specification); rows of 3448 clocks of 182.4 MHz = 18.9 us, 640 x 480 binned (Linux, drivers/media/i2c/imx219.c:
    # IMX219_REG_LINE_LENGTH_A, IMX219_PIXEL_RATE, supported_modes).
    "pi_v2": CameraKind(
        LightConditions(
            vignetting=0.3,
            noise_sd=1.5,
            shot_gain=_noise(4300),
            processing=Processing(mosaic=True, denoise=3.0, gamma=2.2, sharpening=0.5),
            fringe_px=1.0,
        ),
        line_time=18.9e-6,
        auto=AutoSettings(),
    ),
    # Raspberry Pi global shutter camera, Sony IMX296: pixels of 3.45 um, 1456 x 1088 at 60 images a second
    # (documentation of Raspberry Pi, hardware specification); the colour variant is chosen.
    "pi_gs": CameraKind(
        LightConditions(
            noise_sd=1.0,
            shot_gain=_noise(10000),
            processing=Processing(mosaic=True, denoise=2.0, gamma=2.2, sharpening=0.5),
            fringe_px=0.5,
        ),
        auto=AutoSettings(),
    ),
    # A USB module with a monochrome onsemi AR0144, as ELP sells: pixels of 3 um (libcamera,
    # camera_sensor_properties.cpp). No page of the module was found: shutter, motion JPEG and processor are chosen.
    "elp": CameraKind(
        LightConditions(
            noise_sd=1.5,
            shot_gain=_noise(6500),
            processing=Processing(denoise=3.0, gamma=1.8, sharpening=0.5),
            jpeg_quality=85,
            fringe_px=1.0,
        ),
        auto=AutoSettings(),
    ),
    # OV9281: 1280 x 800, monochrome, pixels of 3 um (OmniVision's data sheet, version 1.22, 2017, first page), global
    # shutter (docs.luxonis.com, OV9282: the same but for the angle of its rays, ovti,ov9282.yaml); raw.
    "ov9281": CameraKind(LightConditions(noise_sd=1.5, shot_gain=_noise(6500), fringe_px=0.5)),
    # What flew in 2010: a board camera, an analog 5.8 GHz link and a frame grabber; all chosen, see `analogvideo`.
    "analog": CameraKind(
        LightConditions(
            vignetting=0.25,
            noise_sd=2.0,
            shot_gain=_noise(10000),
            processing=Processing(gamma=2.2),
            analog=AnalogVideo(noise=6.0, disturbed=0.1),
        ),
        auto=AutoSettings(),
    ),
}
"""Kinds by name, from the ideal one to the cheapest."""
