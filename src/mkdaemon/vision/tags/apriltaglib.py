"""libapriltag beyond what pyapriltags wraps: tables of a bearable size, and the library's own drawings of its tags.

pyapriltags corrects two bits of every family, for which libapriltag lists every code with every two bits flipped: 36 MB
for tag36h11, 6 GB for tag52h13. Here large families correct fewer (`TagFamily.corrected_bits`).
"""

from __future__ import annotations

import ctypes
import importlib.util
import threading
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from pyapriltags import Detector as LibDetector

Cells = npt.NDArray[np.uint8]
Families = tuple[tuple[str, int], ...]
"""Names of families and the bits to correct in each."""


class _OfThread(threading.local):
    """Detectors this thread has made."""

    def __init__(self) -> None:
        self.made: dict[Families, LibDetector] = {}


_of_thread = _OfThread()


def is_installed() -> bool:
    """Whether the pyapriltags wheel is there."""
    return importlib.util.find_spec("pyapriltags") is not None


def detector(families: Families, decimate: float) -> LibDetector:
    """The library with its tables for some families; they take time and serve one thread, whose searches share them.

    Args:
        families: what it finds.
        decimate: quads of the next search are found in an image so much smaller; edges are fitted in the whole one.
    """
    if families not in _of_thread.made:
        made, library = _open()
        for name, bits in families:
            library.apriltag_detector_add_family_bits(made.tag_detector_ptr, _family(library, name), bits)
        _of_thread.made[families] = made
    found = _of_thread.made[families]
    assert found.tag_detector_ptr is not None
    found.tag_detector_ptr.contents.quad_decimate = decimate
    return found


def draw(name: str, tag_id: int) -> Cells:
    """Cells of a code as the library knows it `(n, n)` uint8, 0 and 255, with the white border of classic families.

    The wheel has to be there and the code has to exist.
    """
    family, drawn = _drawing(name)
    bitmap = drawn.copy()
    start = (family.total_width - family.width_at_border) // 2
    for k in range(family.nbits):
        is_white = family.codes[tag_id] >> (family.nbits - 1 - k) & 1
        bitmap[start + family.bit_y[k], start + family.bit_x[k]] = 255 * is_white
    return bitmap


@lru_cache(maxsize=16)
def _drawing(name: str) -> tuple[Any, Cells]:
    """A family as the library knows it, and what all its prints have: two rings, nothing beyond them."""
    family = _family(_open()[1], name).contents
    n = family.total_width
    away = np.minimum(np.arange(n), np.arange(n)[::-1])
    beyond = (n - family.width_at_border) // 2 - np.minimum.outer(away, away)
    white = (beyond > 1) | (beyond == (0 if family.reversed_border else 1))
    return family, np.where(white, 255, 0).astype(np.uint8)


def _open() -> tuple[LibDetector, ctypes.CDLL]:
    """A detector without families, and the functions of the library."""
    from pyapriltags import Detector as LibDetector

    made = LibDetector(families="", nthreads=1, refine_edges=1)
    assert made.libc is not None
    return made, made.libc


def _family(library: ctypes.CDLL, name: str) -> Any:
    """A family of its own; pyapriltags has told ctypes what its maker returns."""
    return getattr(library, f"{name}_create")()
