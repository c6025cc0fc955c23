"""Hints for a still image that shows no tag, or too many: causes and remedies. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Final

import cv2
import numpy as np

from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.still import StillEye, StillResult

DARK: Final = 16
"""A picture whose brightest hundredth is below this is nearly black [grey]: 10 bits stored in 16 end at 4."""
ENLARGED: Final = 4
"""Tags that are found only in a picture this many times larger, with room around it, are too small or cut."""
LARGEST_PX: Final = 4000
"""A picture is not enlarged beyond this [px]."""
DICTIONARIES: Final = {
    "tag16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "tag25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "tag36h10": cv2.aruco.DICT_APRILTAG_36h10,
    "tag36h11": cv2.aruco.DICT_APRILTAG_36h11,
}
"""Families that OpenCV reads with a border of two cells, as Kalibr's AprilGrid has it."""


def hints(pixels: Grey, result: StillResult, eye: StillEye, families: Iterable[str]) -> Iterator[str]:
    """Say what can be said about a picture.

    Args:
        pixels: `(h, w)`.
        result: what was found in it.
        eye: what looked at it.
        families: of the tags looked for.
    """
    seen = Counter((tag.found.family, tag.found.tag_id) for tag in result.tags)
    for (family, tag_id), times in seen.items():
        if times > 1:
            yield f"{family} {tag_id} is seen {times} times; a target has each code once: cover the others"
    if seen:
        return
    brightest = np.percentile(pixels, 99)
    if brightest < DARK:
        yield f"nearly black (brightest {brightest:.0f} of 255): scale 10 or 12 bits to 8, or expose longer"
    elif wide := [family for family in families if _has_wide_border(pixels, family)]:
        yield f"{wide[0]} with a border of two cells (Kalibr's AprilGrid): print it with a border of one cell"
    elif max(pixels.shape) * ENLARGED <= LARGEST_PX and _is_small(pixels, eye):
        yield (
            f"a tag is found once the picture of {pixels.shape[1]} x {pixels.shape[0]} px is enlarged with room around "
            "it: a cell needs about 3 px, and the tag white paper around it"
        )


def _has_wide_border(pixels: Grey, family: str) -> bool:
    if family not in DICTIONARIES:
        return False
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = 2
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[family])
    _, codes, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(pixels)
    return codes is not None


def _is_small(pixels: Grey, eye: StillEye) -> bool:
    enlarged = cv2.resize(pixels, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_NEAREST)
    framed = cv2.copyMakeBorder(enlarged, 16, 16, 16, 16, cv2.BORDER_REPLICATE)
    return bool(eye.look(np.asarray(framed, dtype=np.uint8)).tags)
