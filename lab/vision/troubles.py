"""What goes wrong in a flight: things lying on the target, glare, a shadow edge, a lens out of focus, motion, dusk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mksim.scene.light import Cover, Glare, LightConditions, Shadow

Array = npt.NDArray[np.float64]

TROUBLES = ("band", "patches", "glare", "shadow", "defocus", "motion", "dim")


Plan = list[tuple[float, float, LightConditions, float]]
"""Begin and end [s], conditions and exposure time [s] of troubles."""


def plan_troubles(rng: np.random.Generator, seconds: float, side: float) -> Plan:
    """Troubles of half to one and a half seconds with pauses of about the same length."""
    plan: Plan = []
    start = float(rng.uniform(0.5, 1.2))
    while start < seconds:
        end = start + float(rng.uniform(0.5, 1.5))
        plan.append((start, end, *_trouble(str(rng.choice(TROUBLES)), rng, side)))
        start = end + float(rng.uniform(0.2, 1.0))
    return plan


def _trouble(name: str, rng: np.random.Generator, side: float) -> tuple[LightConditions, float]:
    base, shutter = LightConditions(), 0.004
    if name == "band":
        return replace(base, covers=(band(rng, side, float(rng.uniform(0.05, 0.3))),)), shutter
    if name == "patches":
        return replace(base, covers=patches(rng, side, float(rng.uniform(0.05, 0.3)))), shutter
    if name == "glare":
        where = rng.uniform(-0.4, 0.4, 2) * side
        spot = Glare((float(where[0]), float(where[1])), side * float(rng.uniform(0.05, 0.2)), 2.0)
        return replace(base, glare=(spot,)), shutter
    if name == "shadow":
        return replace(base, shadow=shadow(rng, side, float(rng.uniform(2, 5)))), shutter
    if name == "defocus":
        return replace(base, defocus_px=float(rng.uniform(2, 6))), shutter
    if name == "motion":
        return base, float(rng.uniform(0.008, 0.02))
    return replace(base, exposure=float(rng.uniform(0.06, 0.3)), noise_sd=2.5), shutter


def band(rng: np.random.Generator, side: float, share: float) -> Cover:
    """Something lying over one side of the tag: a strip of `share` of the side, from outside inwards."""
    far, half = side * 0.9, side / 2
    edge = half - share * side
    strip = np.array([[-far, edge], [far, edge], [far, far], [-far, far]])
    turn = rng.integers(4) * np.pi / 2
    return _cover(strip, turn, float(rng.uniform(0.05, 0.85)))


def patches(rng: np.random.Generator, side: float, share: float) -> tuple[Cover, ...]:
    """Leaves on the tag: three irregular patches of together `share` of its area."""
    found = []
    for _ in range(3):
        radius = side * np.sqrt(share / 3 / np.pi)
        angles = np.sort(rng.uniform(0, 2 * np.pi, 9))
        ring = radius * rng.uniform(0.8, 1.3, 9)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        found.append(_cover(ring + rng.uniform(-0.45, 0.45, 2) * side, 0.0, float(rng.uniform(0.1, 0.8))))
    return tuple(found)


def shadow(rng: np.random.Generator, side: float, ratio: float) -> Shadow:
    """A hard edge across the tag."""
    where = rng.uniform(-0.35, 0.35, 2) * side
    return Shadow(ratio, (float(where[0]), float(where[1])), float(rng.uniform(0, 2 * np.pi)), 0.0)


def _cover(polygon: Array, turn: float, reflectance: float) -> Cover:
    c, s = np.cos(turn), np.sin(turn)
    turned = polygon @ np.array([[c, s], [-s, c]])
    return Cover(tuple((float(x), float(y)) for x, y in turned), reflectance)
