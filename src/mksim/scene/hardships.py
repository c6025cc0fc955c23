"""The light and the print of a configured scene, and the grass over its rim, as far as they stay for a flight."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from mksim.config import LightConfig
from mksim.scene.curl import Curl
from mksim.scene.gloss import Gloss
from mksim.scene.hindrances import Drops, Flicker, Fog, Propellers
from mksim.scene.lensfaults import Dirt
from mksim.scene.light import Cover, LightConditions
from mksim.scene.shadows import LeafShadow, VehicleShadow
from mksim.scene.view import CameraView, ViewPose

Array = npt.NDArray[np.float64]

BLADE_SHADES = (0.08, 0.16, 0.26)
"""Reflectance of blades in the shade, green and dry ones; chosen."""
BLADE_WIDTH_M = (0.003, 0.007)
BLADE_LENGTH_M = (0.05, 0.14)
"""Of a blade; chosen as a lawn that was left to grow."""


def blades(rng: np.random.Generator, side: float, count: int = 60) -> tuple[Cover, ...]:
    """Blades that lean over a square target from outside.

    Args:
        rng: draws them.
        side: of the largest tag [m]; they are rooted where its quiet zone ends, at 5/8 of the side.
        count: of blades.
    """
    found = []
    for _ in range(count):
        root = np.array([rng.uniform(-0.7, 0.7), rng.uniform(0.6, 0.68)]) * side
        lean = float(rng.normal(-np.pi / 2, 0.6))
        length, width = float(rng.uniform(*BLADE_LENGTH_M)), float(rng.uniform(*BLADE_WIDTH_M))
        tip = root + length * np.array([np.cos(lean), np.sin(lean)])
        beside = 0.5 * width * np.array([-np.sin(lean), np.cos(lean)])
        corners: Array = np.array([root - beside, root + beside, 0.4 * (root + beside) + 0.6 * tip, tip])
        quarter = int(rng.integers(4)) * np.pi / 2
        turn = np.array([[np.cos(quarter), np.sin(quarter)], [-np.sin(quarter), np.cos(quarter)]])
        polygon = tuple((float(x), float(y)) for x, y in corners @ turn)
        found.append(Cover(polygon, float(rng.choice(BLADE_SHADES))))
    return tuple(found)


LEAF_SWAY_M: Final = 0.05
LEAF_PERIOD: Final = 2.0
"""Leaves in the wind: how far their shadows move and how long it takes [s]; chosen."""
TO_SUN: Final = (0.17, 0.05, 1.0)
"""Direction of the sun in target axes: 10 degrees beside the zenith, where a camera above sees it in a glossy print;
chosen."""
SHEET_SIDES: Final = 1.4
"""Width of the sheet over the largest tag on it; chosen, a margin of a fifth of the tag all around."""

PROPELLERS: Final = Propellers(85.0, (0.5, 1.4))
"""5100 revolutions a minute: about what carries a quadrotor of 1.25 kg; chosen."""
DIMMED: Final = 2.0 / 3.0
"""Swing of a lamp that is dimmed to a fifth of its brightest; chosen."""


def fair_conditions(light: LightConfig, camera: LightConditions, side: float, seed: int) -> LightConditions:
    """Conditions of a camera in the configured light.

    Args:
        light: what is configured; noise and vignetting count where they are worse than the camera's own.
        camera: of the kind of camera.
        side: of the largest tag [m].
        seed: draws leaves, grass and dirt.
    """
    curl = None
    if light.curl != 0.0:
        curl = Curl(side / (8 * light.curl), math.radians(30.0), SHEET_SIDES * side)
    return replace(
        camera,
        noise_sd=max(light.noise_sd, camera.noise_sd),
        vignetting=max(light.vignetting, camera.vignetting),
        defocus_px=light.defocus_px,
        gradient=light.gradient,
        leaves=LeafShadow(seed, light.leaves_height) if light.leaves_height > 0.0 else None,
        gloss=Gloss(light.gloss, TO_SUN) if light.gloss > 0.0 else None,
        curl=curl,
        covers=blades(np.random.default_rng([seed, 0x67A5]), side, light.grass),
        dirt=Dirt(seed, light.dirt) if light.dirt > 0.0 else None,
        fog=Fog(light.visibility) if light.visibility > 0.0 else None,
        drops=Drops(seed, light.drops) if light.drops > 0 else None,
        propellers=PROPELLERS if light.propellers else None,
        flicker=Flicker(light.flicker, DIMMED) if light.flicker > 0.0 else None,
        jpeg_quality=light.jpeg_quality if light.jpeg_quality is not None else camera.jpeg_quality,
    )


def shadow_of_vehicle(view: CameraView, target: ViewPose) -> VehicleShadow:
    """Where the vehicle's shadow falls on the target."""
    place = target.enu_from_body.T @ (view.position_enu - target.position_enu)
    nose = target.enu_from_body.T @ view.enu_from_cam[:, 0]
    height = float(place[2])
    x, y = (float(place[k]) - height * TO_SUN[k] for k in (0, 1))
    return VehicleShadow(height, (x, y), math.atan2(float(nose[1]), float(nose[0])))
