"""What stands between the sun and the target: leaves of a tree, and the vehicle itself.

A shadow is a picture of the share of the sun that gets through, laid on the plane of the target. Its edges are as soft
as the sun is wide: 9.3 mrad times the distance of what throws it (the sun's diameter is 0.53 degrees).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mksim.scene.view import RayGrid

Image32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

SUN_WIDTH: Final = 9.3e-3
"""Diameter of the sun [rad]: 1.392 million km at 149.6 million km."""
SUN_OVER_SKY: Final = 6.0
"""Light in the sun over light in the shade: 120 klx, brightest sunlight, and 20 klx, shade under a clear blue sky at
midday (Wikipedia, "Orders of magnitude (illuminance)")."""
TEXELS: Final = 512
LEAVES_M: Final = 1.28
"""Side of the repeating pattern of leaves [m]."""
LEAVES: Final = 260
"""Leaves in it, chosen; 0.69 of the sun gets through (mean of the patterns of four seeds)."""
VEHICLE_M: Final = 1.6
"""Side of the picture of the vehicle's shadow [m]."""
ARM_M: Final = 0.155
PROPELLER_M: Final = 0.127
"""Arm of the simulated airframe (`AirframeConfig.arm`) and radius of a 10 inch propeller [m]."""
PROPELLER_SHADE: Final = 0.12
"""Share of the disc that two turning blades cover: chord of 24 mm, chosen, 2 x 24 / (pi x 127)."""


@dataclass(frozen=True, slots=True)
class LeafShadow:
    """Shadow of a tree over the target.

    Attributes:
        seed: which leaves.
        height: of the leaves over the target [m].
        ratio: light in the sun over light in the shade.
        shift: of the pattern on the target `(x, y)` [m]; wind moves it.
    """

    seed: int
    height: float = 3.0
    ratio: float = SUN_OVER_SKY
    shift: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class VehicleShadow:
    """Shadow of the vehicle on the target.

    Attributes:
        height: of the vehicle over the target [m].
        place: middle of the shadow `(x, y)` [m; target].
        turn: of the vehicle, counter-clockwise from target x [rad].
        ratio: light in the sun over light in the shade.
    """

    height: float
    place: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    ratio: float = SUN_OVER_SKY


@lru_cache(maxsize=8)
def leaf_pattern(seed: int, height: float) -> Image32:
    """Share of the sun under leaves of 5 to 9 cm (chosen), `(TEXELS, TEXELS)`, repeating."""
    rng = np.random.default_rng([seed, 0x1EAF])
    sun = np.full((3 * TEXELS, 3 * TEXELS), 255, dtype=np.uint8)
    texel = LEAVES_M / TEXELS
    for _ in range(LEAVES):
        length = float(rng.uniform(0.05, 0.09)) / texel
        axes = (round(length / 2), round(length * float(rng.uniform(0.2, 0.32))))
        middle, angle = rng.integers(0, TEXELS, 2), float(rng.uniform(0, 180))
        for row in range(3):
            for column in range(3):
                at = (int(middle[0]) + column * TEXELS, int(middle[1]) + row * TEXELS)
                cv2.ellipse(sun, at, axes, angle, 0, 360, 0, -1, cv2.LINE_AA)
    soft = cv2.GaussianBlur(sun.astype(np.float32) / 255, (0, 0), _softness(height) / texel)
    return np.ascontiguousarray(soft[TEXELS : 2 * TEXELS, TEXELS : 2 * TEXELS])


@lru_cache(maxsize=1)
def _vehicle() -> Image32:
    """Share of the sun that gets past a quadrocopter with crossed arms, sharp."""
    sun = np.ones((TEXELS, TEXELS), dtype=np.float32)
    texel, middle = VEHICLE_M / TEXELS, TEXELS // 2
    for quarter in range(4):
        angle = np.pi / 4 + quarter * np.pi / 2
        end = (round(middle + ARM_M / texel * np.cos(angle)), round(middle + ARM_M / texel * np.sin(angle)))
        disc = np.zeros((TEXELS, TEXELS), dtype=np.uint8)
        cv2.circle(disc, end, round(PROPELLER_M / texel), 1, -1)
        sun *= 1 - np.float32(PROPELLER_SHADE) * disc
        cv2.line(sun, (middle, middle), end, 0.0, round(0.02 / texel))
    cv2.circle(sun, (middle, middle), round(0.06 / texel), 0.0, -1)
    return sun


def _softness(height: float) -> float:
    """Deviation of a Gaussian as wide as the image of the sun's disc [m]; a disc's is a quarter of its diameter."""
    return max(0.25 * SUN_WIDTH * height, 1e-3)


def shade_leaves(image: Image32, shadow: LeafShadow, rays: RayGrid, plane_from_ray: Array) -> None:
    """Darken `image` in place under leaves; `plane_from_ray` `(3, 3)` carries rays to homogeneous plane points."""
    pattern = leaf_pattern(shadow.seed, shadow.height)
    x, y = _on_plane(rays, plane_from_ray)
    scale = np.float32(TEXELS / LEAVES_M)
    u, v = np.mod(x - np.float32(shadow.shift[0]), LEAVES_M), np.mod(y - np.float32(shadow.shift[1]), LEAVES_M)
    image *= _light(
        cv2.remap(pattern, u * scale, v * scale, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), shadow.ratio
    )


def shade_vehicle(image: Image32, shadow: VehicleShadow, rays: RayGrid, plane_from_ray: Array) -> None:
    """Darken `image` in place under the vehicle."""
    scale = TEXELS / VEHICLE_M
    pattern = cv2.GaussianBlur(_vehicle(), (0, 0), max(_softness(shadow.height) * scale, 0.5))
    x, y = _on_plane(rays, plane_from_ray)
    x, y = x - np.float32(shadow.place[0]), y - np.float32(shadow.place[1])
    c, s = np.float32(scale * np.cos(shadow.turn)), np.float32(scale * np.sin(shadow.turn))
    half = np.float32(TEXELS / 2)
    u, v = np.clip(c * x + s * y + half, -9.0, TEXELS + 9.0), np.clip(c * y - s * x + half, -9.0, TEXELS + 9.0)
    sun = cv2.remap(pattern, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0)
    image *= _light(sun, shadow.ratio)


def _on_plane(rays: RayGrid, plane_from_ray: Array) -> tuple[Image32, Image32]:
    """Where every pixel sees the plane of the target [m]; far away where it does not."""
    m = plane_from_ray.astype(np.float32)
    x, y = rays.x, rays.y
    w = np.maximum(m[2, 0] * x + m[2, 1] * y + m[2, 2], np.float32(1e-4))
    return (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / w, (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / w


def _light(sun: cv2.typing.MatLike, ratio: float) -> Image32:
    """Light where a share of the sun gets through."""
    dark = np.float32(1.0 / ratio)
    return dark + (1 - dark) * np.asarray(sun, dtype=np.float32)
