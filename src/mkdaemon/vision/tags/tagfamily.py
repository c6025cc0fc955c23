"""Bitmaps of the AprilTag families in the orientation of the official prints.

Conventions used everywhere in `mkdaemon.vision`:

* The size of a tag is the side of its square, edge to edge [m]: what a ruler measures on the print. That is the black
  square of the classic families (tag36h11, tag25h9, tag16h5), and of the inverted ones of AprilTag 3, which have data
  outside their border, the white square inside the black ring.
* Corners are those of that square in the order top-left, top-right, bottom-right, bottom-left of the official
  print held upright, in pixels whose centres lie at integer coordinates.
* The frame of a tag has its origin in the centre of the print, x to the right, y to the top and z out of the paper
  towards the reader.

Bitmaps are drawn from the codes of libapriltag; OpenCV has those of the classic families turned by 180 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyapriltags

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Array, Bools, Grey

QUIET_ZONE_CELLS = 1
"""White cells a print carries around everything black."""


@dataclass(frozen=True, slots=True)
class TagFamily:
    """Geometry of the codes of one family.

    Attributes:
        name: AprilTag's name, for example `tag36h11`.
        size_cells: side of the square that is the tag's size [cells].
        black_cells: side of the square that holds everything black [cells]; larger in inverted families alone.
        bits: of a code.
        ids: number of codes; valid ids are 0 to `ids - 1`.
        corrected_bits: wrong bits that libapriltag corrects, two at most: it lists all codes with these bits flipped,
            here a million at most, 48 bytes each (apriltag.c, `quick_decode_init`).
        hole_cells: side of the square in the middle that carries nothing, room for a smaller tag [cells].
    """

    name: str
    size_cells: int
    black_cells: int
    bits: int
    ids: int
    corrected_bits: int
    hole_cells: int = 0

    @property
    def is_inverted(self) -> bool:
        """Whether the square is white inside a black ring, and data lie outside that."""
        return self.size_cells != self.black_cells


FAMILIES: dict[str, TagFamily] = {
    family.name: family
    for family in (
        TagFamily("tag36h11", 8, 8, 36, 587, 2),
        TagFamily("tag25h9", 7, 7, 25, 35, 2),
        TagFamily("tag16h5", 6, 6, 16, 30, 2),
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
_LIBRARY: Final[Any] = pyapriltags.Detector(families="").libc
"""Functions of libapriltag."""


def to_rim(n: int) -> npt.NDArray[np.intp]:
    """Number of cells between each of `(n, n)` and the rim."""
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
    """Words for the measured side of a print of this family."""
    return "side of the white square inside the black ring" if family.is_inverted else "side of the black square"


@lru_cache(maxsize=256)
def cells(family: str, tag_id: int) -> Grey:
    """Return the bitmap of an official print, without the white cells around it.

    Returns:
        `(n, n)` uint8, 0 black and 255 white, row 0 at the top, `n = black_cells`; read-only.

    Raises:
        VisionError: unknown family or id.
    """
    known = find_family(family)
    if not 0 <= tag_id < known.ids:
        msg = f"{family} has no id {tag_id}: use 0 to {known.ids - 1}"
        raise VisionError(msg)
    ring = (known.black_cells - known.size_cells) // 2
    # Outwards: the square's own ring is white in inverted families alone, the next one is black, and all others white.
    beyond = ring - to_rim(known.black_cells)
    white = (beyond > 1) | (known.is_inverted & (beyond == 0))
    white[_bits_at(known)] = [bit == "1" for bit in f"{_codes_of(family).codes[tag_id]:0{known.bits}b}"]
    bitmap = np.where(white, 255, 0).astype(np.uint8)
    bitmap.setflags(write=False)
    return bitmap


def coded(family: TagFamily) -> Bools:
    """Which cells of a print `(n, n)` carry bits of its code; the others are those of all codes."""
    found = np.zeros((family.black_cells,) * 2, dtype=bool)
    found[_bits_at(family)] = True
    return found


def _bits_at(family: TagFamily) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Rows and columns of the bits in a bitmap of a family, in their order."""
    codes, ring = _codes_of(family.name), (family.black_cells - family.size_cells) // 2
    row, column = (ring + np.array(at[: family.bits], dtype=np.intp) for at in (codes.bit_y, codes.bit_x))
    return row, column


@lru_cache(maxsize=16)
def _codes_of(name: str) -> Any:
    """Codes of a family, and where their bits stand from the corner of the square: `apriltag_family_t`."""
    return getattr(_LIBRARY, f"{name}_create")().contents
