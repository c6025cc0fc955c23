"""Finding tags in an image by a ladder of searches at a bounded cost; chance has to explain hardly what they find.

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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Literal

import cv2
import numpy as np

from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.cellread import TURNS, Covered, chance, has_sides
from mkdaemon.vision.tags.detection import Detection, Stage, best_of_codes
from mkdaemon.vision.tags.libraries import LOST_WITHOUT_APRILTAG, AprilTagSearch, ArucoSearch
from mkdaemon.vision.tags.outline import OutlineSearch, has_highlights
from mkdaemon.vision.tags.tagfamily import find_family, is_installed

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
_LOG: Final[Grey] = np.round(100 + 14 * (np.log10(np.arange(256) + 4.0) - np.log10(64.0))).clip(0, 255).astype(np.uint8)
"""Compresses bright and dark halves of a shadow to equal steps; 14 levels a decade merge texture below a real edge."""
_LIGHT: Final[Grey] = np.round(255 * (np.arange(256) / 255) ** LIMITS.search.tone).astype(np.uint8)
"""Light from grey values: a tone curve lets white cells spread over small black ones, which then read as white."""
TONES: Final[Mapping[Stage, Grey]] = {"linear": _LIGHT, "halflog": _LOG, "log": _LOG}
"""What is seen in place of each grey value; the other stages see the image as it is."""


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


class Detector:
    """Searches images for the tags of a whitelist.

    Attributes:
        backend: `apriltag` or, without its wheel, `aruco`.
        stages: its searches of the whole image.
        warning: what the fallback loses; empty with `apriltag`.
    """

    def __init__(
        self,
        whitelist: Mapping[str, frozenset[int]],
        *,
        max_chance: float = LIMITS.read.max_chance,
        backend: Literal["auto", "apriltag", "aruco"] = "auto",
        covered: Covered | None = None,
    ) -> None:
        """Prepare the searches.

        Args:
            whitelist: ids by family.
            max_chance: that a random quad reads as one of them, where cells read wrong or not at all.
            backend: which library; `auto` takes the best that is installed.
            covered: cells that another tag lies on (`tagmap.covered_cells`); a broken outline is read without them.

        Raises:
            VisionError: an unknown family, or one that only pyapriltags can search for, without its wheel.
        """
        if backend == "auto":
            backend = "apriltag" if is_installed() else "aruco"
        self.backend = backend
        self.warning = LOST_WITHOUT_APRILTAG if backend == "aruco" else ""
        self._whitelist, self._max_chance = whitelist, max_chance
        families = tuple(whitelist)
        self._whole = AprilTagSearch(families) if backend == "apriltag" else ArucoSearch(families)
        # Outlines are those of something black, and an inverted tag has data there.
        classic = {name: ids for name, ids in whitelist.items() if not find_family(name).is_inverted}
        self._broken = OutlineSearch(classic, covered or {})
        self.stages: tuple[Stage, ...] = tuple(stage for stage in LADDER if classic or stage != "outline")

    def looks(self, pixels: Grey) -> tuple[Look, ...]:
        """The searches of an image that take turns beside the first ones, in highlights that for outlines first."""
        height, width = pixels.shape
        stages = sorted(self.stages, key=lambda stage: stage != "outline") if has_highlights(pixels) else self.stages
        return looks_of(width, height, tuple(stages))

    def search(self, pixels: Grey, stage: Stage, part: Part | None = None) -> list[Detection]:
        """Run one search at a bounded cost: a large part is shrunk.

        Args:
            pixels: `(h, w)` uint8.
            stage: which search.
            part: of the image; the whole of it where it is none.

        Returns:
            Tags that are believed, at most one per code: the one with the clearest bits.
        """
        height, width = pixels.shape
        x0, y0, x1, y1 = part or (0, 0, width, height)
        found = self.search_all(pixels, stage, part, shrunk=shrinking(x1 - x0, y1 - y0))
        return best_of_codes(found, lambda tag: (-tag.hamming, tag.decision_margin))

    def search_all(
        self, pixels: Grey, stage: Stage = "decimate1", part: Part | None = None, *, shrunk: int = 1
    ) -> list[Detection]:
        """Every tag of one search that is believed, also several with the same code; see `search`."""
        height, width = pixels.shape
        x0, y0, x1, y1 = part or (0, 0, width, height)
        seen = pixels[y0:y1, x0:x1]
        if min(seen.shape) < LIMITS.search.min_window_px * shrunk:
            return []  # libapriltag crashes on a few rows
        if stage in TONES:
            seen = np.asarray(cv2.LUT(seen, TONES[stage]), dtype=np.uint8)
        search = self._broken if stage == "outline" else self._whole
        if isinstance(search, AprilTagSearch):
            found, scale = search.find(seen, shrunk * (2.0 if stage in FIRST else 1.0)), 1
        else:
            found, scale = search.find(shrink(seen, shrunk)), shrunk
        # centres of pixels are whole numbers: the middle of the first block is at (scale - 1) / 2
        first = np.array([x0, y0]) + (scale - 1) / 2
        placed = (replace(tag, corners=scale * tag.corners + first, stage=stage, shrunk=scale) for tag in found)
        return [tag for tag in placed if self._is_believed(pixels, tag)]

    def _is_believed(self, pixels: Grey, found: Detection) -> bool:
        """Whether a tag is wanted, and explained by chance less often than allowed; and whole where that was taken."""
        ids, family = self._whitelist.get(found.family, frozenset()), find_family(found.family)
        if found.tag_id not in ids:
            return False
        if found.hamming > 0 and chance(family.bits, found.hamming, TURNS * len(ids)) > self._max_chance:
            return False
        is_open = found.stage == "outline"
        return is_open or has_sides(pixels, found.corners, family.size_cells, inverted=family.is_inverted)
