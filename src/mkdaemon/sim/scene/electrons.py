"""From light in lux to grey values and their noise: a sensor whose exposure and gain act."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from mkdaemon.sim.scene.light import FULL_LIGHT, Conditions

PHOTONS_PER_LUX_S_M2: Final = 1.0e16
"""Visible photons of daylight; 4.1e15 at 555 nm, where the eye is most sensitive (683 lm/W)."""


@dataclass(frozen=True, slots=True)
class PhotonSensor:
    """A sensor behind a lens. The default is like an OV9281 behind an M12 lens.

    Attributes:
        pixel_m: side of a pixel; 3 um (product page of the OV9281).
        f_number: of the lens; 2.4 is common among M12 lenses.
        efficiency: electrons for a visible photon that reaches the sensor, lens included.
        full_well: electrons at grey 255 with the least gain.
        read_noise: electrons, independent of light.
        greatest_gain: over the least.
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

    def conditions(self, fair: Conditions, lux: float, exposure: float, gain: float) -> Conditions:
        """Brightness and noise of an image.

        Args:
            fair: everything else.
            lux: light on the scene; 100,000 in the sun, 400 in an office, 10 at dusk, 1 in deep twilight, 0.2 under a
                full moon.
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
