"""Gloss: a coat on the print that mirrors the sky and smears the sun, on black ink as on white paper.

A smooth coat of refractive index 1.5 (chosen, as of glass) mirrors 4 % of what falls on it, more at grazing views, by
Schlick's approximation, r + (1 - r) (1 - cos)^5. Roughness spreads the mirrored sun into a lobe. Computed for slopes
with a Gaussian distribution of deviation `s` in each axis (Beckmann's): its peak is 1 / (2 pi s^2), the lobe sends 0.04
times a quarter of that, 0.04 / (8 pi s^2), and a perfect white reflector 1 / pi.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from mksim.scene.view import RayGrid

Image32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

MIRRORED: Final = 0.04
"""Share of the light a coat of index 1.5 mirrors at a right angle: ((1.5 - 1) / (1.5 + 1))^2."""
SKY_SHARE: Final = 1.0 / 6.0
"""Light of the clear sky over that of sun and sky together: 20 klx of 120 klx, as in `shadows`."""


@dataclass(frozen=True, slots=True)
class Gloss:
    """A coat on the print, and the sun.

    Attributes:
        roughness: deviation of the coat's normals [rad]; the smaller, the smaller and brighter its image of the sun. At
            0.3 the lobe adds 5 % of white paper (0.04 x 5/6 / (8 x 0.3^2)). No coat was measured.
        to_sun: direction of the sun `(3,)` in target axes, any length, z up.
    """

    roughness: float
    to_sun: tuple[float, float, float]


def add_gloss(image: Image32, mask: Image32, gloss: Gloss, rays: RayGrid, cam_from_target: Array) -> None:
    """Add what the coat mirrors, in place.

    Args:
        image: `(h, w)` light, 1 is a perfect reflector in full light.
        mask: `(h, w)` share of each pixel the print covers.
        gloss: the coat.
        rays: of the camera.
        cam_from_target: rotation `(3, 3)`.
    """
    sun = cam_from_target @ (np.array(gloss.to_sun) / np.linalg.norm(gloss.to_sun))
    normal = cam_from_target[:, 2].astype(np.float32)
    length = np.sqrt(rays.x**2 + rays.y**2 + 1)
    # Blinn's half vector h = (sun - ray) / |sun - ray|; Beckmann's lobe exp(-tan^2 / (2 s^2)) / (8 s^2) of its angle to
    # the normal (the module's docstring has the factor); Schlick's share m + (1 - m) (1 - cos)^5.
    # halfway between the direction to the eye (minus the ray) and to the sun: the normal of a mirror
    half = [np.float32(sun[k]) - part / length for k, part in enumerate((rays.x, rays.y, np.float32(1.0)))]
    size = np.sqrt(half[0] ** 2 + half[1] ** 2 + half[2] ** 2)
    cosine = np.clip((half[0] * normal[0] + half[1] * normal[1] + half[2] * normal[2]) / size, 1e-3, 1.0)
    tangent2 = 1 / cosine**2 - 1
    facing = np.clip(-(rays.x * normal[0] + rays.y * normal[1] + normal[2]) / length, 1e-3, 1.0)
    mirrored = MIRRORED + (1 - MIRRORED) * (1 - facing) ** 5
    s2 = gloss.roughness**2
    lobe = (1 - SKY_SHARE) * np.exp(-tangent2 / (2 * s2)) / (8 * s2)
    image += np.asarray(mask * mirrored * (SKY_SHARE + lobe), dtype=np.float32)
