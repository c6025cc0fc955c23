"""Finding tags in an image by searches at a bounded cost, which take turns; docs/vision.md, "Search", says why.

There are four views. In three tones libapriltag looks for unbroken quads; the fourth are broken outlines
(`outline.py`). The first search of every image sees at most `max_pixels` in one of the tones, at half their resolution.
One other joins it in every image of `thorough_every`: at their whole resolution, or of a tile of a larger image.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
import pyapriltags

from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.tags.cellread import (
    TURNS,
    CodeReader,
    Covered,
    Detection,
    View,
    best_of_codes,
    chance,
    has_sides,
)
from mkdaemon.vision.tags.outline import read_outlines
from mkdaemon.vision.tags.tagfamily import find_family

Part = tuple[int, int, int, int]
"""`(x0, y0, x1, y1)` [px], end exclusive."""


class Look(NamedTuple):
    """One search, as `Detector.search` takes it."""

    view: View
    part: Part | None = None
    decimate: int = 1


TONES: Final[tuple[View, ...]] = ("grey", "light", "log")
"""Views of an image whose unbroken quads are read, in turn."""
FIRST: Final = tuple(Look(tone, decimate=2) for tone in TONES)
"""Searches of which every image gets one, in turn: 3 to 6 ms on VGA."""
FINE: Final[tuple[View, ...]] = ("log", "grey")
"""Tones for small tags; light needs tags that are large at half the resolution too."""
OVERLAP: Final = 37
"""Of neighbouring tiles, times as many pixels as the whole image is shrunk by: a tag of 28 px with its quiet zone is
large enough for the whole image."""
_LOG: Final[Grey] = np.round(100 + 14 * (np.log10(np.arange(256) + 4.0) - np.log10(64.0))).clip(0, 255).astype(np.uint8)
"""Compresses bright and dark halves of a shadow to equal steps; 14 levels a decade merge texture below a real edge."""
_LIGHT: Final[Grey] = np.round(255 * (np.arange(256) / 255) ** LIMITS.search.tone).astype(np.uint8)
_SEEN: Final[Mapping[View, Grey]] = {"light": _LIGHT, "log": _LOG}
"""What is seen in place of each grey value; the other views see it as it is."""


@lru_cache(maxsize=16)
def looks_of(width: int, height: int, *, outline_first: bool = False) -> tuple[Look, ...]:
    """The additional searches of an image of this size, which take turns."""
    fine, outline = tuple(Look(tone) for tone in FINE), (Look("outline"),)
    whole = outline + fine if outline_first else fine + outline
    shrunk = shrinking(width, height)
    if shrunk == 1:
        return whole
    half = OVERLAP * shrunk // 2
    # As few tiles a side as have to be shrunk no more.
    counts = (n for n in range(shrunk, 4 * shrunk) if shrinking(width // n + 2 * half, height // n + 2 * half) == 1)
    count = next(counts, shrunk)
    across, down = (
        [(max(k * length // count - half, 0), min((k + 1) * length // count + half, length)) for k in range(count)]
        for length in (width, height)
    )
    tiles = [Look(tone, (x0, y0, x1, y1)) for tone in FINE for y0, y1 in down for x0, x1 in across]
    turns = itertools.cycle(whole)
    return tuple(look for tile in tiles for look in (next(turns), tile))


def shrinking(width: int, height: int) -> int:
    """By how much an image is shrunk for a search of all of it."""
    return math.ceil(math.sqrt(width * height / LIMITS.search.max_pixels))


class Detector:
    """Searches images for the tags of a whitelist.

    Args:
        whitelist: ids by family.
        max_chance: that a random quad reads as one of them, where cells read wrong or not at all.
        covered: cells that another tag lies on (`tagmap.covered_cells`); a broken outline is read without them.

    Raises:
        VisionError: an unknown family.
    """

    def __init__(
        self,
        whitelist: Mapping[str, frozenset[int]],
        *,
        max_chance: float = LIMITS.read.max_chance,
        covered: Covered | None = None,
    ) -> None:
        self._whitelist, self._max_chance = whitelist, max_chance
        # Outlines are those of something black, and an inverted tag has data there.
        classic = {name: ids for name, ids in whitelist.items() if not find_family(name).is_inverted}
        self._reader = CodeReader(classic, covered or {})

    def search(self, pixels: Grey, view: View, part: Part | None = None, decimate: int = 1) -> list[Detection]:
        """Run one search at a bounded cost.

        Args:
            pixels: `(h, w)` uint8.
            view: what is seen.
            part: of the image; the whole of it where it is none.
            decimate: by how much it is shrunk for unbroken quads alone, once more where it is large.

        Returns:
            Accepted tags, at most one per code.
        """
        x0, y0, x1, y1 = part or (0, 0, *pixels.shape[::-1])
        return best_of_codes(self.search_all(pixels, view, part, decimate, shrunk=shrinking(x1 - x0, y1 - y0)))

    def search_all(
        self, pixels: Grey, view: View = "grey", part: Part | None = None, decimate: int = 1, *, shrunk: int = 1
    ) -> list[Detection]:
        """Every accepted tag of one search, also several with the same code, at any cost; see `search`."""
        x0, y0, x1, y1 = part or (0, 0, *pixels.shape[::-1])
        seen = pixels[y0:y1, x0:x1]
        if min(seen.shape) < LIMITS.search.min_window_px * shrunk:
            return []  # libapriltag crashes on a few rows
        if view in _SEEN:
            seen = np.asarray(cv2.LUT(seen, _SEEN[view]), dtype=np.uint8)
        if view == "outline":
            resized = cv2.resize(seen, None, fx=1 / shrunk, fy=1 / shrunk, interpolation=cv2.INTER_AREA)
            small = np.asarray(resized, dtype=np.uint8)
            found, ratio = read_outlines(small, self._reader), np.divide(seen.shape, small.shape)[::-1]
        else:
            found, ratio = find_codes(self._whitelist, seen, decimate * shrunk), np.ones(2)
        # Centres of pixels are whole numbers.
        first = np.array([x0, y0]) - HALF
        coarse = round(ratio[0])
        placed = (replace(tag, corners=(tag.corners + HALF) * ratio + first, view=view, shrunk=coarse) for tag in found)
        return [tag for tag in placed if self._is_believed(pixels, tag)]

    def _is_believed(self, pixels: Grey, found: Detection) -> bool:
        """Whether a tag is wanted, and explained by chance less often than allowed; and whole where that was taken."""
        ids, family = self._whitelist.get(found.family, frozenset()), find_family(found.family)
        if found.tag_id not in ids:
            return False
        if found.hamming > 0 and chance(family.bits, found.hamming, TURNS * len(ids)) > self._max_chance:
            return False
        is_open = found.view == "outline"
        return is_open or has_sides(pixels, found.corners, family.size_cells, inverted=family.is_inverted)


_of_thread = threading.local()
"""Libraries this thread has opened, by their families; they end with it."""


def library_of(families: Collection[str]) -> Any:
    """Libapriltag with the tables of families; they take time and serve one thread, whose searches share them.

    pyapriltags carries upstream's fix of `refine_edges`, which pupil-apriltags and dt-apriltags lack.
    """
    of_thread, key = vars(_of_thread), " ".join(families)
    if key not in of_thread:
        library: Any = pyapriltags.Detector(families="", nthreads=1, refine_edges=1)
        for name in families:
            family, bits = getattr(library.libc, f"{name}_create")(), find_family(name).corrected_bits
            library.libc.apriltag_detector_add_family_bits(library.tag_detector_ptr, family, bits)
        of_thread[key] = library
    return of_thread[key]


def find_codes(families: Collection[str], pixels: Grey, decimate: float = 1.0) -> list[Detection]:
    """All codes libapriltag sees in `(h, w)` uint8; it searches quads in an image reduced by `decimate`."""
    library = library_of(families)
    library.tag_detector_ptr.contents.quad_decimate = decimate
    return [
        Detection(
            family=item.tag_family.decode(),
            tag_id=item.tag_id,
            hamming=item.hamming,
            decision_margin=float(item.decision_margin),
            # libapriltag: counter-clockwise from the print's bottom-left, pixel centres at +0.5.
            corners=item.corners[[3, 2, 1, 0]] - 0.5,
        )
        for item in library.detect(np.asarray(pixels, dtype=np.uint8, order="C"))
    ]
