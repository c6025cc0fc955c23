"""Bitmaps of the AprilTag families in the orientation of the official prints.

Conventions used everywhere in `mkdaemon.vision`:

* The size of a tag is the side of its square, edge to edge [m]: what a ruler measures on the print. That is the black
  square of the classic families (tag36h11, tag25h9, tag16h5), and of the inverted ones of AprilTag 3, which have data
  outside their border, the white square inside the black ring.
* Corners are those of that square in the order top-left, top-right, bottom-right, bottom-left of the official
  print held upright, in pixels whose centres lie at integer coordinates.
* The frame of a tag has its origin in the centre of the print, x to the right, y to the top and z out of the paper
  towards the reader.

OpenCV carries the same codes turned by 180 degrees (measured), so every bitmap is turned once, here. The inverted
families are unknown to OpenCV; they are drawn from the codes of libapriltag.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Array, Grey

QUIET_ZONE_CELLS = 1
"""White cells a print carries around everything black."""


@dataclass(frozen=True, slots=True)
class TagFamily:
    """What the code of one family looks like.

    Attributes:
        name: AprilTag's name, for example `tag36h11`.
        size_cells: side of the square that is the tag's size [cells].
        black_cells: side of the square that holds everything black [cells]; larger in inverted families alone.
        bits: of a code.
        ids: number of codes; valid ids are 0 to `ids - 1`.
        corrected_bits: wrong bits that libapriltag corrects, two at most: it lists all codes with so many flipped, here
            a million at most, 48 bytes each (apriltag.c, `quick_decode_init`).
        dictionary: OpenCV's predefined dictionary of the same codes, turned by 180 degrees; none for inverted families.
        hole_cells: side of the square in the middle that carries nothing, room for a smaller tag [cells].
    """

    name: str
    size_cells: int
    black_cells: int
    bits: int
    ids: int
    corrected_bits: int
    dictionary: int | None = None
    hole_cells: int = 0

    @property
    def is_inverted(self) -> bool:
        """Whether the square is white inside a black ring, and data lie outside that."""
        return self.dictionary is None


FAMILIES: dict[str, TagFamily] = {
    family.name: family
    for family in (
        TagFamily("tag36h11", 8, 8, 36, 587, 2, cv2.aruco.DICT_APRILTAG_36h11),
        TagFamily("tag25h9", 7, 7, 25, 35, 2, cv2.aruco.DICT_APRILTAG_25h9),
        TagFamily("tag16h5", 6, 6, 16, 30, 2, cv2.aruco.DICT_APRILTAG_16h5),
        TagFamily("tagStandard41h12", 5, 9, 41, 2115, 1),
        TagFamily("tagStandard52h13", 6, 10, 52, 48714, 0),
        TagFamily("tagCustom48h12", 6, 10, 48, 42211, 0, hole_cells=2),
        TagFamily("tagCircle21h7", 5, 9, 21, 38, 2),
        TagFamily("tagCircle49h12", 5, 11, 49, 65535, 0),
    )
}
"""All families pyapriltags has. Sources: Olson, AprilTag, ICRA 2011 (name = tag<bits>h<distance>); Krogius,
Haggenmiller and Olson, Flexible layouts for fiducial tags, IROS 2019; figures: `apriltag_family_t`. The distance is
the smallest between two codes, rotations included [bit]."""


def to_rim(n: int) -> npt.NDArray[np.intp]:
    """How many cells lie between each of `(n, n)` and the rim."""
    away = np.minimum(np.arange(n), np.arange(n)[::-1])
    return np.minimum.outer(away, away)


def middles(n: int) -> Array:
    """Middles (column, row) of `n` x `n` cells, row by row `(n * n, 2)` [cells; from the top left corner]."""
    return np.column_stack(np.divmod(np.arange(n * n), n)[::-1]) + 0.5


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
def cells(family: str, tag_id: int) -> Grey:
    """Return the bitmap of an official print, without the white cells around it.

    Returns:
        `(n, n)` uint8, 0 black and 255 white, row 0 at the top, `n = black_cells`; read-only.

    Raises:
        VisionError: unknown family or id, or one that only pyapriltags can draw, without its wheel.
    """
    known = find_family(family)
    if not 0 <= tag_id < known.ids:
        msg = f"{family} has no id {tag_id}: use 0 to {known.ids - 1}"
        raise VisionError(msg)
    if known.is_inverted and is_installed():
        bitmap = draw(family, tag_id)
    else:
        drawn = cv2.aruco.generateImageMarker(dictionary_of(family), tag_id, known.black_cells)
        bitmap = np.ascontiguousarray(np.rot90(drawn, 2), dtype=np.uint8)
    bitmap.setflags(write=False)
    return bitmap


def dictionary_of(family: str) -> cv2.aruco.Dictionary:
    """OpenCV's codes of a family, turned by 180 degrees.

    Raises:
        VisionError: unknown family, or one that OpenCV has not.
    """
    known = find_family(family).dictionary
    if known is None:
        names = ", ".join(one.name for one in FAMILIES.values() if one.dictionary is not None)
        msg = f"tag family {family} needs the pyapriltags wheel; install it, or use one of {names}"
        raise VisionError(msg)
    return cv2.aruco.getPredefinedDictionary(known)


def is_installed() -> bool:
    """Whether the pyapriltags wheel is there."""
    return importlib.util.find_spec("pyapriltags") is not None


def open_library() -> Any:
    """Libapriltag through pyapriltags, whose wheel has to be there: a detector in one thread, without families."""
    from pyapriltags import Detector as LibDetector

    return LibDetector(families="", nthreads=1, refine_edges=1)


@lru_cache(maxsize=16)
def _in_library(name: str) -> Any:
    """Codes of a family, and where their bits stand, as libapriltag has them."""
    return getattr(open_library().libc, f"{name}_create")().contents


def draw(name: str, tag_id: int) -> Grey:
    """Cells of a code as the wheel's library has it `(n, n)` uint8, with the white border of classic families."""
    family = _in_library(name)
    n, count, start = family.total_width, family.nbits, (family.total_width - family.width_at_border) // 2
    beyond = start - to_rim(n)
    # All prints have two rings, and nothing beyond them.
    white = (beyond > 1) | (beyond == (0 if family.reversed_border else 1))
    white[start + np.array(family.bit_y[:count]), start + np.array(family.bit_x[:count])] = [
        bit == "1" for bit in f"{family.codes[tag_id]:0{count}b}"
    ]
    return np.where(white, 255, 0).astype(np.uint8)
