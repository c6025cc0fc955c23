"""What stands between a print and the sensor (fog, drops on the lens, propellers), and a light that flickers.

All of it changes light `(h, w)`, 1 is a perfect reflector in full light, after the lens has drawn it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mksim.scene.view import CameraView, RayGrid, ViewPose

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]

KOSCHMIEDER: Final = 3.912
"""Extinction times visibility, where 2 % of a contrast are left (Koschmieder, Beitraege zur Physik der freien
Atmosphaere 12, 1924)."""
GRAZING: Final = 1e-3
"""Cosine of rays that meet no ground: they end in the fog."""
DROP_PX: Final = (5.0, 20.0)
"""Radius of drops in an image of 640 pixels [px]; chosen."""
DROP_RIM: Final = 0.15
"""Out of focus: share of its radius over which a drop begins."""
DROP_BLUR: Final = 0.6
"""Deviation of the blur in drops, over the radius of the largest."""
BLADES: Final = 2
BLADE_SHADE: Final = 0.04
"""Reflectance of a black propeller seen against the light."""


@dataclass(frozen=True, slots=True)
class Fog:
    """Fog of one density.

    Attributes:
        visibility: distance over which 2 % of a contrast are left [m].
        airlight: light that it scatters towards the camera where it is thick.
    """

    visibility: float
    airlight: float = 0.7


@dataclass(frozen=True, slots=True)
class Drops:
    """Rain on the front of the lens.

    Attributes:
        seed: where they are.
        count: of them.
    """

    seed: int
    count: int = 60


@dataclass(frozen=True, slots=True)
class Propellers:
    """Two-bladed propellers that reach into the upper corners of the image; a rolling shutter bends them.

    Attributes:
        rate: of turning [rev/s].
        phase: of both at time 0 `(2,)` [rad].
        width: angle that a blade covers [rad].
        reach: of a blade, over the width of the image; the hubs lie outside, by `hub` of it.
        hub: how far a hub lies left or right of the image and above it, over its width.
    """

    rate: float
    phase: tuple[float, float]
    width: float = 0.3
    reach: float = 0.7
    hub: float = 0.12


@dataclass(frozen=True, slots=True)
class Flicker:
    """Light of lamps whose brightness swings; a rolling shutter makes bands of it.

    Attributes:
        rate: of its swing [Hz].
        depth: of its swing, 0 to 1.
        phase: at time 0 [rad].
    """

    rate: float
    depth: float
    phase: float = 0.0


def add_fog(light: Image32, fog: Fog, view: CameraView, rays: RayGrid, plane: ViewPose) -> Image32:
    """Light through fog, over the distance to the plane that the scene lies in: L exp(-d) + A (1 - exp(-d))."""
    normal = view.enu_from_cam.T @ plane.enu_from_body[:, 2]
    height = -float(normal @ view.camera_points(plane.position_enu[None])[0])
    down = -(np.float32(normal[0]) * rays.x + np.float32(normal[1]) * rays.y + np.float32(normal[2]))
    length = np.sqrt(1.0 + rays.x**2 + rays.y**2)
    distance = height * length / np.maximum(down, np.float32(GRAZING))
    left = np.exp(-np.float32(KOSCHMIEDER / fog.visibility) * distance)
    return np.asarray(light * left + np.float32(fog.airlight) * (1.0 - left), dtype=np.float32)


def add_drops(light: Image32, drops: Drops) -> Image32:
    """Light behind drops: each shows the whole scene, small, upside down and out of focus."""
    height, width = light.shape
    cover, x, y = _drops(drops, width, height)
    blurred = np.asarray(cv2.GaussianBlur(light, (0, 0), DROP_BLUR * DROP_PX[1] * width / 640), dtype=np.float32)
    seen = cv2.remap(blurred, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
    return np.asarray(light + cover * (seen - light), dtype=np.float32)


@lru_cache(maxsize=4)
def _drops(drops: Drops, width: int, height: int) -> tuple[Image32, Image32, Image32]:
    """How much each pixel sees through a drop, and where it looks then `(h, w)` each."""
    rng = np.random.default_rng([drops.seed, 0xD209])
    v, u = np.mgrid[:height, :width].astype(np.float32)
    cover, x, y = np.zeros_like(u), u.copy(), v.copy()
    for _ in range(drops.count):
        at = rng.uniform(0.0, (width, height))
        radius = float(rng.uniform(*DROP_PX)) * width / 640
        away = np.hypot(u - np.float32(at[0]), v - np.float32(at[1]))
        inside = away < radius * (1.0 + DROP_RIM)
        cover[inside] = np.maximum(cover, np.clip((1.0 + DROP_RIM - away / radius) / DROP_RIM, 0.0, 1.0))[inside]
        turned = np.float32(-width / (2.0 * radius))  # its rim looks half an image away, to the other side
        x[inside] = np.float32(at[0]) + turned * (u[inside] - np.float32(at[0]))
        y[inside] = np.float32(at[1]) + turned * (v[inside] - np.float32(at[1]))
    return cover, x, y


def row_times(view: CameraView) -> Array:
    """When the middle of each row's exposure is `(h,)` [s]."""
    height = view.intrinsics.height
    rows = np.arange(height, dtype=np.float64) - (height - 1) / 2
    return np.asarray(view.time + rows * view.line_time, dtype=np.float64)


def add_propellers(light: Image32, propellers: Propellers, view: CameraView) -> Image32:
    """Light with blades before it.

    A blade that covers an angle w and turns by s while the shutter is open hides a direction for a share of that time:
    of its angle from the middle of the blade a trapezoid, the box of w through the box of s.
    """
    # share(a) = clip(((w + s) / 2 - |a|) / min(w, s), 0, 1) * w / max(w, s), a the angle from the middle of a blade.
    height, width = light.shape
    v, u = np.mgrid[:height, :width].astype(np.float32)
    turns = 2.0 * np.pi * propellers.rate * row_times(view)[:, None]
    swept = 2.0 * np.pi * propellers.rate * view.exposure_time
    wide, narrow = max(propellers.width, swept), min(propellers.width, swept)
    part = np.pi * 2 / BLADES
    around = int(np.ceil((wide + narrow) / (2 * part)))
    for side, phase in zip((-1.0, 1.0), propellers.phase, strict=True):
        hub = ((width - 1) / 2 + side * (width / 2 + propellers.hub * width), -propellers.hub * width)
        angle = np.arctan2(v - hub[1], u - hub[0]) - side * turns - phase
        away = (angle + part / 2) % part - part / 2
        share: Array = np.zeros(away.shape)
        for other in range(-around, around + 1):
            covered = ((wide + narrow) / 2 - np.abs(away + other * part)) / max(narrow, 1e-6)
            share = share + np.clip(covered, 0.0, 1.0) * (propellers.width / wide)
        share = share * (np.hypot(u - hub[0], v - hub[1]) < propellers.reach * width)
        light = np.asarray(light + share.astype(np.float32) * (np.float32(BLADE_SHADE) - light), dtype=np.float32)
    return light


def flickered(light: Image32, flicker: Flicker, view: CameraView) -> Image32:
    """Light of a swinging lamp, averaged over the exposure of each row: its depth by sin(x) / x, x = pi rate time."""
    depth = flicker.depth * float(np.sinc(flicker.rate * view.exposure_time))
    swing = 1.0 + depth * np.cos(2.0 * np.pi * flicker.rate * row_times(view) + flicker.phase)
    return np.asarray(light * swing.astype(np.float32)[:, None], dtype=np.float32)
