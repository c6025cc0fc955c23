"""Grass that has grown over the rim of a target."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mksim.scene.light import Cover

Array = npt.NDArray[np.float64]

SHADES = (0.08, 0.16, 0.26)
"""Reflectance of blades in the shade, green and dry ones; chosen."""
WIDTH_M = (0.003, 0.007)
LENGTH_M = (0.05, 0.14)
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
        length, width = float(rng.uniform(*LENGTH_M)), float(rng.uniform(*WIDTH_M))
        tip = root + length * np.array([np.cos(lean), np.sin(lean)])
        beside = 0.5 * width * np.array([-np.sin(lean), np.cos(lean)])
        corners: Array = np.array([root - beside, root + beside, 0.4 * (root + beside) + 0.6 * tip, tip])
        quarter = int(rng.integers(4)) * np.pi / 2
        turn = np.array([[np.cos(quarter), np.sin(quarter)], [-np.sin(quarter), np.cos(quarter)]])
        polygon = tuple((float(x), float(y)) for x, y in corners @ turn)
        found.append(Cover(polygon, float(rng.choice(SHADES))))
    return tuple(found)
