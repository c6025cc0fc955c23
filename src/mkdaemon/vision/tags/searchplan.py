"""The ways to find a tag, and which of them an image is searched in: all of them have their turn at a bounded cost.

There are four. Three have libapriltag look for unbroken quads, each in other tones: the grey values as they are;
their logarithm, where a shadow's edge or leaves are as large a step as ink on paper; and light, where a tone curve lets
white cells spread over small black ones. The first two also see the whole resolution, for small tags. The fourth looks
for broken outlines (`outline.py`), where something lies over the border or a highlight opens it.

A search takes time in proportion to the pixels. The first search of every image therefore sees it shrunk to at most
`max_pixels`, and one other search joins it in every image of `thorough_every`: the other stages on the shrunk image,
and, in turn with them, those for small tags on tiles of less shrunk levels. A tag that is too small on one level fits
into the overlap of the tiles on the next one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

import cv2
import numpy as np

from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.limits import LIMITS

Stage = Literal["decimate2", "decimate1", "log", "halflog", "linear", "outline"]
"""A way to search an image for tags, at half or at full resolution."""
Part = tuple[int, int, int, int]
"""`(x0, y0, x1, y1)` [px], end exclusive."""

FIRST: Final[tuple[Stage, ...]] = ("decimate2", "linear", "halflog")
"""Stages of which one sees every image, in turn, at half its resolution: 3 to 6 ms on VGA."""
SMALL_TAG_STAGES: Final[tuple[Stage, ...]] = ("log", "decimate1")
"""Searches for small tags; the others need tags that are large on the coarsest level too."""
NEARBY: Final[tuple[Stage, ...]] = ("decimate1", "linear", "log")
"""Searches of a window where a target should be, in turn."""
LADDER: Final[tuple[Stage, ...]] = (*FIRST, *SMALL_TAG_STAGES, "outline")
"""Searches of the whole image."""
TILE: Final = (640, 480)
"""Size of a tile on its level [px]."""
OVERLAP: Final = 112
"""Of neighbouring tiles on their level [px]: a tag of 85 px with its quiet zone, 2.8 px a cell on a level 3 times as
coarse."""
FINER: Final = 3
"""Ratio of neighbouring levels, at most."""


@dataclass(frozen=True, slots=True)
class Look:
    """One search.

    Attributes:
        stage: how.
        part: of the image; the whole of it where it is none.
    """

    stage: Stage
    part: Part | None = None


@lru_cache(maxsize=16)
def looks_of(width: int, height: int, stages: Sequence[Stage]) -> tuple[Look, ...]:
    """The searches that take turns beside the first ones.

    Args:
        width: of the image [px].
        height: of the image [px].
        stages: of the detector, the first ones included.
    """
    whole = [Look(stage) for stage in stages if stage not in FIRST]
    tiles: list[Look] = []
    scale = shrinking(width, height)
    while scale > 1:
        scale = math.ceil(scale / FINER)
        parts = [
            (x, y, min(x + TILE[0] * scale, width), min(y + TILE[1] * scale, height))
            for y in _starts(height, TILE[1] * scale, OVERLAP * scale)
            for x in _starts(width, TILE[0] * scale, OVERLAP * scale)
        ]
        tiles += [Look(stage, part) for stage in stages if stage in SMALL_TAG_STAGES for part in parts]
    if not tiles:
        return tuple(whole)
    turns = itertools.cycle(whole)
    return tuple(look for tile in tiles for look in (next(turns), tile))


def shrinking(width: int, height: int) -> int:
    """By how much an image is shrunk for a search of all of it."""
    return math.ceil(math.sqrt(width * height / LIMITS.search.max_pixels))


def shrink(part: Grey, scale: int) -> Grey:
    """Mean over `scale` x `scale` pixels; what is left over at the right and lower edge is cut off."""
    height, width = (length // scale for length in part.shape)
    whole = part[: height * scale, : width * scale]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _starts(length: int, tile: int, overlap: int) -> list[int]:
    """First pixels of tiles along one side, evenly spaced."""
    if length <= tile:
        return [0]
    count = math.ceil((length - overlap) / (tile - overlap))
    return [round(k * (length - tile) / (count - 1)) for k in range(count)]
