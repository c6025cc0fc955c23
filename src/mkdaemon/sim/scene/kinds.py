"""Cameras people fly, beside their lens: shutter, processor, noise, automatics. One table, by name.

What a data sheet or a driver says is cited; what none says (tone curve, sharpening, denoising of a webcam's processor,
its automatics) is a level measured on no single specimen, chosen in the middle of what such cameras do.

Noise: with a full well of N electrons photons have a variance of 255 / N grey values for each grey value, at gain 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from mkdaemon.sim.scene.autoexposure import AutoSettings
from mkdaemon.sim.scene.light import Conditions
from mkdaemon.sim.scene.processing import Processing

KindName = Literal["ideal", "c270", "c920", "pi_v2", "pi_gs", "elp", "ov9281"]


@dataclass(frozen=True, slots=True)
class CameraKind:
    """What a camera does beside its lens.

    Attributes:
        conditions: noise, lens faults and processing in fair weather.
        line_time: between neighbouring rows at 640 x 480 [s]; 0 is a global shutter.
        auto: how it chooses its exposure when nobody tells it; none where it has no processor of its own.
    """

    conditions: Conditions
    line_time: float = 0.0
    auto: AutoSettings | None = None


def _noise(full_well: float) -> float:
    """Variance of a grey value for each grey value; see the module."""
    return 255.0 / full_well


CAMERA_KINDS: Final[dict[KindName, CameraKind]] = {
    # Noise and vignetting of the configured light alone.
    "ideal": CameraKind(Conditions(noise_sd=0.0, vignetting=0.0)),
    # Logitech C270: 1280 x 720 at 30 images a second, fixed focus, plastic lens, motion JPEG (product page). Its
    # read-out is in no data sheet: nearly the whole 33 ms; `mkdaemon calibrate shutter` measures it.
    "c270": CameraKind(
        Conditions(
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
    # Logitech C920: 1920 x 1080 at 30 images a second, glass lens, 78 degrees across the diagonal (product page).
    "c920": CameraKind(
        Conditions(
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
    # Raspberry Pi camera 2, Sony IMX219: pixels of 1.12 um, f/2.0 (documentation of Raspberry Pi); rows of 3448
    # clocks of 182.4 MHz = 18.9 us (drivers/media/i2c/imx219.c), 640 x 480 binned; 4300 electrons (as camera 1).
    "pi_v2": CameraKind(
        Conditions(
            vignetting=0.3,
            noise_sd=1.5,
            shot_gain=_noise(4300),
            processing=Processing(mosaic=True, denoise=3.0, gamma=2.2, sharpening=0.5),
            fringe_px=1.0,
        ),
        line_time=18.9e-6,
        auto=AutoSettings(),
    ),
    # Raspberry Pi global shutter camera, Sony IMX296: pixels of 3.45 um, 1456 x 1088 at 60 images a second, colour
    # (documentation of Raspberry Pi); about 10,000 electrons, as the other sensors with Sony's pixels of 3.45 um.
    "pi_gs": CameraKind(
        Conditions(
            noise_sd=1.0,
            shot_gain=_noise(10000),
            processing=Processing(mosaic=True, denoise=2.0, gamma=2.2, sharpening=0.5),
            fringe_px=0.5,
        ),
        auto=AutoSettings(),
    ),
    # ELP global shutter modules for USB with onsemi AR0144: 1280 x 800, pixels of 3 um, monochrome (product pages).
    "elp": CameraKind(
        Conditions(
            noise_sd=1.5,
            shot_gain=_noise(6500),
            processing=Processing(denoise=3.0, gamma=1.8, sharpening=0.5),
            jpeg_quality=85,
            fringe_px=1.0,
        ),
        auto=AutoSettings(),
    ),
    # Arducam OV9281: 1280 x 800 at 120 images a second, pixels of 3 um, global shutter, monochrome, raw (product page).
    "ov9281": CameraKind(Conditions(noise_sd=1.5, shot_gain=_noise(6500), fringe_px=0.5)),
}
"""Kinds by name, from the ideal one to the cheapest."""
