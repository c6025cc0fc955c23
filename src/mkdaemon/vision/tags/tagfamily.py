"""Bitmaps of the AprilTag families in the orientation of the official prints.

Conventions used everywhere in `mkdaemon.vision`:

* The size of a tag is the side of its square, edge to edge [m]: what a ruler measures on the print. That is the black
  square of the classic families (tag36h11, tag25h9, tag16h5), and of the inverted ones of AprilTag 3, which have data
  outside their border, the white square inside the black ring.
* Corners are those of that square in the order top-left, top-right, bottom-right, bottom-left of the official
  print held upright, in pixels whose centres lie at integer coordinates.
* The frame of a tag has its origin in the centre of the print, x to the right, y to the top and z out of the paper
  towards the reader.

OpenCV carries the same codes turned by 180 degrees (measured: a tag drawn by `cv2.aruco.generateImageMarker` decodes
in libapriltag with the homography of an upside-down print), so every bitmap is turned once, here. The inverted families
are unknown to OpenCV; libapriltag draws them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError
from mkdaemon.vision.tags.apriltaglib import draw, is_installed

Cells = npt.NDArray[np.uint8]

QUIET_ZONE_CELLS = 1
"""White cells a print carries around everything black."""
MOST_ENTRIES: Final = 1_000_000
"""Codes with flipped bits that libapriltag may list; each takes 48 bytes (apriltag.c, `quick_decode_init`)."""
MOST_CORRECTED: Final = 2


@dataclass(frozen=True, slots=True)
class TagFamily:
    """What the code of one family looks like.

    Attributes:
        name: AprilTag's name, for example `tag36h11`.
        size_cells: side of the square that is the tag's size [cells]; the size divided by this is one module.
        black_cells: side of the square that holds everything black [cells]; equal to `size_cells` where the border is
            outermost.
        bits: of a code.
        ids: number of codes; valid ids are 0 to `ids - 1`.
        min_distance: smallest Hamming distance between two codes of the family, rotations included [bit].
        dictionary: OpenCV's predefined dictionary of the same codes, turned by 180 degrees; none for inverted families.
        hole_cells: side of the square in the middle that carries nothing, room for a smaller tag [cells].
    """

    name: str
    size_cells: int
    black_cells: int
    bits: int
    ids: int
    min_distance: int
    dictionary: int | None = None
    hole_cells: int = 0

    @property
    def is_inverted(self) -> bool:
        """Whether the square is white inside a black ring, and data lie outside that."""
        return self.dictionary is None

    @property
    def corrected_bits(self) -> int:
        """Wrong bits libapriltag corrects; few in large families, whose tables would not fit into memory."""
        entries = accumulate(self.ids * math.comb(self.bits, flipped) for flipped in range(MOST_CORRECTED + 1))
        return sum(listed <= MOST_ENTRIES for listed in entries) - 1


FAMILIES: dict[str, TagFamily] = {
    family.name: family
    for family in (
        TagFamily("tag36h11", 8, 8, 36, 587, 11, cv2.aruco.DICT_APRILTAG_36h11),
        TagFamily("tag25h9", 7, 7, 25, 35, 9, cv2.aruco.DICT_APRILTAG_25h9),
        TagFamily("tag16h5", 6, 6, 16, 30, 5, cv2.aruco.DICT_APRILTAG_16h5),
        TagFamily("tagStandard41h12", 5, 9, 41, 2115, 12),
        TagFamily("tagStandard52h13", 6, 10, 52, 48714, 13),
        TagFamily("tagCustom48h12", 6, 10, 48, 42211, 12, hole_cells=2),
        TagFamily("tagCircle21h7", 5, 9, 21, 38, 7),
        TagFamily("tagCircle49h12", 5, 11, 49, 65535, 12),
    )
}
"""All families pyapriltags has. Sources: Olson, AprilTag, ICRA 2011 (name = tag<bits>h<distance>); Krogius,
Haggenmiller and Olson, Flexible layouts for fiducial tags, IROS 2019; figures: `apriltag_family_t`."""
OPENCV_KNOWS: Final = ", ".join(family.name for family in FAMILIES.values() if family.dictionary is not None)
"""Families that need no wheel."""


def find_family(name: str) -> TagFamily:
    """Look a family up by name.

    Raises:
        VisionError: there is no such family; the message lists those there are.
    """
    family = FAMILIES.get(name)
    if family is None:
        msg = f"tag family '{name}' is not known: use one of {', '.join(FAMILIES)}"
        raise VisionError(msg)
    return family


def size_words(family: TagFamily) -> str:
    """What of a print of this family is measured."""
    return "side of the white square inside the black ring" if family.is_inverted else "side of the black square"


@lru_cache(maxsize=256)
def cells(family: str, tag_id: int) -> Cells:
    """Return the bitmap of an official print, without the white cells around it.

    Args:
        family: for example `tag36h11`.
        tag_id: the code.

    Returns:
        `(n, n)` uint8, 0 black and 255 white, row 0 at the top, `n = black_cells`; read-only.

    Raises:
        VisionError: unknown family or id, or one that only pyapriltags can draw, without its wheel.
    """
    known = find_family(family)
    if not 0 <= tag_id < known.ids:
        msg = f"{family} has no id {tag_id}: use 0 to {known.ids - 1}"
        raise VisionError(msg)
    if known.dictionary is not None:
        codes = cv2.aruco.getPredefinedDictionary(known.dictionary)
        drawn = cv2.aruco.generateImageMarker(codes, tag_id, known.black_cells)
        bitmap = np.ascontiguousarray(np.rot90(drawn, 2), dtype=np.uint8)
    elif is_installed():
        bitmap = draw(family, tag_id)
    else:
        msg = f"tag family {family} needs the pyapriltags wheel; install it, or use one of {OPENCV_KNOWS}"
        raise VisionError(msg)
    bitmap.setflags(write=False)
    return bitmap
