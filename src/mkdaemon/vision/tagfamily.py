"""Bitmaps of the AprilTag families in the orientation of the official prints.

Conventions used everywhere in `mkdaemon.vision`:

* The size of a tag is the side of its black square, edge to edge [m]: what a ruler measures on the print.
* Corners are those of the black square in the order top-left, top-right, bottom-right, bottom-left of the official
  print held upright, in pixels whose centres lie at integer coordinates.
* The frame of a tag has its origin in the centre of the print, x to the right, y to the top and z out of the paper
  towards the reader.

OpenCV carries the same codes turned by 180 degrees (measured: a tag drawn by `cv2.aruco.generateImageMarker` decodes
in libapriltag with the homography of an upside-down print), so every bitmap is turned once, here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError

Cells = npt.NDArray[np.uint8]

QUIET_ZONE_CELLS = 1
"""White cells an official print carries around its black square."""


@dataclass(frozen=True, slots=True)
class TagFamily:
    """What the code of one family looks like.

    Attributes:
        name: AprilTag's name, for example `tag36h11`.
        data_cells: side of the coded square [cells].
        ids: number of codes; valid ids are 0 to `ids - 1`.
        min_distance: smallest Hamming distance between two codes of the family, rotations included [bit].
        dictionary: OpenCV's predefined dictionary of the same codes, turned by 180 degrees.
    """

    name: str
    data_cells: int
    ids: int
    min_distance: int
    dictionary: int

    @property
    def black_cells(self) -> int:
        """Side of the black square, border included [cells]; the tag size divided by this is one module."""
        return self.data_cells + 2


FAMILIES: dict[str, TagFamily] = {
    family.name: family
    for family in (
        TagFamily("tag36h11", 6, 587, 11, cv2.aruco.DICT_APRILTAG_36h11),
        TagFamily("tag25h9", 5, 35, 9, cv2.aruco.DICT_APRILTAG_25h9),
        TagFamily("tag16h5", 4, 30, 5, cv2.aruco.DICT_APRILTAG_16h5),
    )
}
"""The families with a classic black border. Source: Olson, AprilTag, ICRA 2011 (name = tag<bits>h<distance>)."""


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


@lru_cache(maxsize=256)
def _bitmap(name: str, tag_id: int) -> Cells:
    family = find_family(name)
    if not 0 <= tag_id < family.ids:
        msg = f"{name} has no id {tag_id}: use 0 to {family.ids - 1}"
        raise VisionError(msg)
    dictionary = cv2.aruco.getPredefinedDictionary(family.dictionary)
    drawn = cv2.aruco.generateImageMarker(dictionary, tag_id, family.black_cells)
    bitmap: Cells = np.ascontiguousarray(np.rot90(drawn, 2), dtype=np.uint8)
    bitmap.setflags(write=False)
    return bitmap


def cells(family: str, tag_id: int, quiet: int = 0) -> Cells:
    """Return the bitmap of an official print.

    Args:
        family: for example `tag36h11`.
        tag_id: the code.
        quiet: white cells to add on every side; an official print has `QUIET_ZONE_CELLS`.

    Returns:
        `(n, n)` uint8, 0 black and 255 white, row 0 at the top, `n = data_cells + 2 + 2 * quiet`; read-only when
        `quiet` is 0.

    Raises:
        VisionError: unknown family or id.
    """
    bitmap = _bitmap(family, tag_id)
    if quiet == 0:
        return bitmap
    return np.pad(bitmap, quiet, constant_values=255)
