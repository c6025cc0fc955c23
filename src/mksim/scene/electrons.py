"""From light in lux to grey values and their noise: a sensor whose exposure and gain act."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from mksim.scene.light import FULL_LIGHT, LightConditions

PHOTONS_PER_LUX_S_M2: Final = 1.0e16
"""Visible photons of daylight. Computed, 400 to 700 nm: 1.1e16 for black bodies of 5500 to 6500 K, by Planck's law, 683
lm/W and a photopic curve of 1.019 exp(-285.4 (x - 0.559)^2), x in um; rounded down. At 555 nm alone it is 4.1e15."""


@dataclass(frozen=True, slots=True)
class PhotonSensor:
    """A sensor behind a lens. The default is like an OV9281 behind an M12 lens; what names no source is chosen.

    Attributes:
        pixel_m: side of a pixel; 3 um (OmniVision's data sheet of the OV9281, version 1.22).
        f_number: of the lens.
        efficiency: electrons for a visible photon that reaches the sensor, lens included.
        full_well: electrons at grey 255 with the least gain.
        read_noise: electrons, independent of light.
        greatest_gain: over the least: registers 0x10 to 0xff (Linux, drivers/media/i2c/ov9282.c).
    """

    pixel_m: float = 3.0e-6
    f_number: float = 2.4
    efficiency: float = 0.3
    full_well: float = 6500.0
    read_noise: float = 4.0
    greatest_gain: float = 16.0

    def electrons(self, lux: float, exposure: float) -> float:
        """Electrons a perfect white reflector gives a pixel in an exposure [s]: E / 4 N^2 on the sensor."""
        on_sensor = lux / (4.0 * self.f_number**2)
        return on_sensor * exposure * PHOTONS_PER_LUX_S_M2 * self.efficiency * self.pixel_m**2

    def conditions(self, fair: LightConditions, lux: float, exposure: float, gain: float) -> LightConditions:
        """Brightness and noise of an image.

        Args:
            fair: everything else.
            lux: light on the scene; 110,000 in the sun, 400 at sunset, 0.25 under a full moon (Wikipedia, "Orders of
                magnitude (illuminance)"), 10 in twilight, 1 in deep twilight (apexcctv.com, "Lux explanation").
            exposure: [s].
            gain: over the least.
        """
        grey = 255.0 / self.full_well * gain
        return replace(
            fair,
            exposure=self.electrons(lux, exposure) * grey / FULL_LIGHT,
            noise_sd=((self.read_noise * grey) ** 2 + 0.29**2) ** 0.5,
            shot_gain=grey,
        )
