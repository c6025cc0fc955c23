"""Which nested target is read farthest, whatever the camera's tone curve: an inner tag brightens what it covers.

A view is drawn without the renderer: the print at 64 texels a module, blurred by lens and pixel, sampled. It takes a
millisecond, so that hundreds of layouts can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from lab.vision.parts import Case, Part
from lab.vision.stills import SeedSet, target_named
from mkdaemon.vision.tags.detector import find_codes
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Target, single
from mksim.scene.layers import INK, PAPER

Array = npt.NDArray[np.float64]
Image32 = npt.NDArray[np.float32]
Grey = npt.NDArray[np.uint8]

FAMILY: Final = "tag36h11"
SIDE: Final = 0.3048
"""Of the outer tag [m]: 12 inch."""
CELLS: Final = 8
TEXELS: Final = 48
"""Per module of the outer tag."""
FOCAL: Final = 600.0
SPREAD_PX: Final = 0.66
"""Deviation of lens (0.6 px) and pixel (1/sqrt(12)) together [px]."""
NOISE: Final = 2.0
GROUND: Final = 0.4
"""Reflectance around the print."""
GAMMAS: Final = (1.0, 1.6, 2.2)
DISTANCES: Final = (0.6, 1.0, 1.7, 3.0, 4.6, 6.0, 8.0, 10.0, 12.0)
"""Of the outer tag [m], from where it fits into the image."""
SIZES: Final = (0.030, 0.033, 0.036, 0.040, 0.044, 0.048, 0.054)
"""Of inner tags that are tried [m]."""


@dataclass(frozen=True, slots=True)
class Layout:
    """A tag inside a tag.

    Attributes:
        outer: id.
        inner: id.
        size: of the inner tag [m].
        x: its middle on the outer tag [m].
        y: up [m].
        quiet: white cells around it; 0 where the outer cells are white already.
    """

    outer: int
    inner: int
    size: float
    x: float = 0.0
    y: float = 0.0
    quiet: int = 1


@lru_cache(maxsize=1024)
def bits(tag_id: int) -> Grey:
    """All cells of a tag `(8, 8)`, 1 is white."""
    return np.asarray(single(SIDE, tag_id).tags[0].bitmap > 0, dtype=np.uint8)


def layout_of(target: Target) -> Layout:
    """Of a target of two tags with their axes parallel."""
    outer, inner = target.tags[0], target.tags[1]
    x, y = (inner.position - outer.position)[:2] * SIDE / outer.size
    return Layout(outer.tag_id, inner.tag_id, inner.size * SIDE / outer.size, float(x), float(y))


def drawn(layout: Layout) -> Image32:
    """Reflectance of the print with one white module around it."""
    cells = np.pad(bits(layout.outer), 1, constant_values=1)
    fine = np.kron(cells, np.ones((TEXELS, TEXELS), np.uint8)).astype(np.float32)
    texel = SIDE / CELLS / TEXELS
    inner = np.pad(bits(layout.inner), layout.quiet, constant_values=1).astype(np.float32)
    side = round(layout.size / CELLS * len(inner) / texel)
    patch = cv2.resize(inner, (side, side), interpolation=cv2.INTER_NEAREST)
    left = round(fine.shape[1] / 2 + layout.x / texel - side / 2)
    top = round(fine.shape[0] / 2 - layout.y / texel - side / 2)
    fine[top : top + side, left : left + side] = patch
    return np.asarray(INK + (PAPER - INK) * fine, dtype=np.float32)


def seen(printed: Image32, distance: float, gamma: float, rng: np.random.Generator) -> Grey:
    """The print from straight above, turned and shifted at random."""
    texel = SIDE / CELLS / TEXELS
    scale = FOCAL * texel / distance
    side = int(np.ceil(1.6 * scale * printed.shape[0])) + 16
    sheet = np.dstack([printed, np.ones_like(printed)])
    blurred = np.asarray(cv2.GaussianBlur(sheet, (0, 0), SPREAD_PX / scale, borderType=cv2.BORDER_CONSTANT))
    soft = np.asarray(blurred[..., 0] + GROUND * (1.0 - blurred[..., 1]), dtype=np.float32)
    turn, (u, v) = float(rng.uniform(0, 2 * np.pi)), rng.uniform(-0.5, 0.5, 2) + side / 2
    c, s = scale * np.cos(turn), scale * np.sin(turn)
    middle = (printed.shape[0] - 1) / 2
    to = np.array([[c, -s, u - c * middle + s * middle], [s, c, v - s * middle - c * middle]])
    light = cv2.warpAffine(soft, to, (side, side), flags=cv2.INTER_LINEAR, borderValue=GROUND)
    light = np.clip(light + NOISE / 255 * rng.standard_normal(light.shape), 0, 1)
    return np.asarray(np.rint(255 * light ** (1 / gamma)), dtype=np.uint8)


def read_share(layout: Layout, seed: int, views: int) -> dict[tuple[float, float], float]:
    """Share of views in which plain AprilTag reads the outer tag, by distance and gamma."""
    printed, shares = drawn(layout), {}
    for distance, gamma in product(DISTANCES, GAMMAS):
        rng = np.random.default_rng([seed, int(100 * distance), int(10 * gamma)])
        images = (seen(printed, distance, gamma, rng) for _ in range(views))
        found = sum(any(tag.tag_id == layout.outer for tag in find_codes((FAMILY,), image)) for image in images)
        shares[distance, gamma] = found / views
    return shares


def candidates(inner: int = 1) -> list[Layout]:
    """Inner tags in the middle of four black or four white cells, of several sizes."""
    found = []
    for outer in range(find_family(FAMILY).ids):
        middle = bits(outer)[3:5, 3:5]
        if middle.min() == middle.max():
            found += [Layout(outer, inner, size) for size in SIZES]
    return found


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    count = 6 if quick else 40
    shipped = [(name, layout_of(target_named(name))) for name in ("nested", "nested-36")]
    black, white = (next(c.outer for c in candidates() if bits(c.outer)[3, 3] == value) for value in (0, 1))
    tried = [
        (f"{colour} middle, {1000 * size:.0f} mm", Layout(outer, 1, size))
        for colour, outer in (("black", black), ("white", white))
        for size in SIZES
    ]
    return [
        Part(_row, (name, layout, seeds.base + 1500, count), count * len(DISTANCES) * len(GAMMAS))
        for name, layout in shipped + tried
    ]


def _row(_name: str, layout: Layout, seed: int, views: int) -> dict[str, float]:
    shares = read_share(layout, seed, views)
    worst = {gamma: min(shares[distance, gamma] for distance in DISTANCES) for gamma in GAMMAS}
    return {
        **{f"{distance:g} m, gamma {gamma:g}": round(share, 3) for (distance, gamma), share in shares.items()},
        **{f"worst, gamma {gamma:g}": round(share, 3) for gamma, share in worst.items()},
    }


def _sum_up(_quick: bool, parts: Sequence[Part], rows: Sequence[dict[str, float]]) -> dict[str, Any]:
    return {part.args[0]: row for part, row in zip(parts, rows, strict=True)}


LAYOUTS: Final = Case(_plan, _sum_up)
"""Share of views in which plain AprilTag reads the outer tag, by distance and tone curve: shipped targets, others."""
