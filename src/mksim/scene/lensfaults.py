"""A lens as it is: colours that are magnified differently, and dirt that scatters light."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

Image32 = npt.NDArray[np.float32]

LUMA: Final = (0.299, 0.587, 0.114)
"""Shares of red, green and blue in a grey value (BT.601)."""
SMEAR_PX: Final = 5.0
"""Reach of what a smear scatters near, deviation [px] at 640 pixels; chosen."""
VEIL_SHARE: Final = 0.4
"""Part of the scattered light that goes anywhere in the image; chosen."""


@dataclass(frozen=True, slots=True)
class Dirt:
    """Finger marks, dust and water on the front of the lens; all out of focus.

    Attributes:
        seed: where they are.
        scattered: share of the light that is scattered in the middle of a mark, 0 to 1; chosen, no mark was measured.
        covered: share of the image the marks lie before; chosen.
    """

    seed: int
    scattered: float = 0.35
    covered: float = 0.5


def add_fringe(light: Image32, fringe_px: float) -> Image32:
    """Grey light of a lens whose red is magnified more and whose blue less than its green.

    Args:
        light: `(h, w)`.
        fringe_px: distance of red and blue in the corner of the image [px].
    """
    height, width = light.shape
    corner = float(np.hypot(width, height)) / 2
    out = np.float32(LUMA[1]) * light
    for share, sign in ((LUMA[0], 0.5), (LUMA[2], -0.5)):
        scale = 1.0 + sign * fringe_px / corner
        x, y = (1 - scale) * (width - 1) / 2, (1 - scale) * (height - 1) / 2
        to = np.array([[scale, 0.0, x], [0.0, scale, y]])
        out += np.float32(share) * cv2.warpAffine(
            light, to, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
    return np.asarray(out, dtype=np.float32)


def grey_scale(fringe_px: float, width: int, height: int) -> float:
    """By how much such a lens magnifies the middle of an edge in its grey images, over its green.

    Red lies farther out and has more of the grey than blue.

    Args:
        fringe_px: distance of red and blue in the corner of the image [px].
        width: of the image [px].
        height: of the image [px].
    """
    corner = float(np.hypot(width, height)) / 2
    return 1.0 + (LUMA[0] - LUMA[2]) * 0.5 * fringe_px / corner


def add_dirt(light: Image32, dirt: Dirt) -> Image32:
    """Light `(h, w)` behind a dirty lens: a part of it goes to near pixels, another part anywhere."""
    height, width = light.shape
    marks = np.float32(dirt.scattered) * dirt_map(dirt.seed, dirt.covered, width, height)
    sent = marks * light
    near = cv2.GaussianBlur(sent, (0, 0), SMEAR_PX * width / 640)
    small = cv2.resize(sent, (width // 16, height // 16), interpolation=cv2.INTER_AREA)
    far = cv2.resize(cv2.GaussianBlur(small, (0, 0), width / 64), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(light - sent + (1 - VEIL_SHARE) * near + VEIL_SHARE * far, dtype=np.float32)


@lru_cache(maxsize=4)
def dirt_map(seed: int, covered: float, width: int, height: int) -> Image32:
    """How thick the dirt is, 0 to 1: cloudy marks over a share of the image, and a few drops."""
    rng = np.random.default_rng([seed, 0xD127])
    cloud = rng.standard_normal((12, 16)).astype(np.float32)
    cloud = np.asarray(cv2.resize(cloud, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.float32)
    marks = np.clip((cloud - np.float32(np.quantile(cloud, 1 - covered))) / (0.5 * cloud.std()), 0.0, 1.0)
    for _ in range(12):
        at = (int(rng.integers(width)), int(rng.integers(height)))
        cv2.circle(marks, at, round(float(rng.uniform(0.015, 0.05)) * width), 1.0, -1)
    return np.asarray(cv2.GaussianBlur(marks, (0, 0), width / 80), dtype=np.float32)
