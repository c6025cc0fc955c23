"""libapriltag beyond what pyapriltags wraps: tables of a bearable size, and the library's own drawings of its tags.

pyapriltags corrects two bits of every family, for which libapriltag lists every code with every two bits flipped: 36 MB
for tag36h11, 6 GB for tag52h13. Here large families correct fewer.
"""

from __future__ import annotations

import ctypes
import importlib.util
import math
import threading
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from pyapriltags import Detector as LibDetector

Cells = npt.NDArray[np.uint8]

MOST_ENTRIES: Final = 1_000_000
"""Codes with flipped bits that are listed; an entry takes 48 bytes (apriltag.c, `quick_decode_init`)."""
MOST_CORRECTED: Final = 2


class _Image(ctypes.Structure):
    """`image_u8_t` of libapriltag."""

    _fields_ = (
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("stride", ctypes.c_int32),
        ("pixels", ctypes.POINTER(ctypes.c_uint8)),
    )


class _Libraries(threading.local):
    """Detectors this thread has made."""

    def __init__(self) -> None:
        self.made: dict[tuple[tuple[str, ...], float, bool], LibDetector] = {}


_libraries = _Libraries()


def is_installed() -> bool:
    """Whether the pyapriltags wheel is there."""
    return importlib.util.find_spec("pyapriltags") is not None


def corrected_bits(ids: int, bits: int) -> int:
    """Bits that are corrected in a family of `ids` codes of `bits` bits."""
    entries, corrected = ids, 0
    for flipped in range(1, MOST_CORRECTED + 1):
        entries += ids * math.comb(bits, flipped)
        if entries > MOST_ENTRIES:
            break
        corrected = flipped
    return corrected


def detector(families: tuple[tuple[str, int], ...], decimate: float, *, refine: bool) -> LibDetector:
    """The library with its tables for some families; they take time and serve one thread, whose searches share them.

    Args:
        families: names and the bits to correct in each.
        decimate: quads are searched in an image so much smaller.
        refine: fit the edges of quads in the whole image.
    """
    key = (tuple(name for name, _ in families), decimate, refine)
    if key not in _libraries.made:
        made = _empty(decimate, refine=refine)
        for name, bits in families:
            # A family's tables go with the detector that has it, so every detector has its own.
            library = _functions(made)
            library.apriltag_detector_add_family_bits(made.tag_detector_ptr, _create(library, name), bits)
        _libraries.made[key] = made
    return _libraries.made[key]


def draw(name: str, tag_id: int) -> Cells:
    """What the library draws for a code: `(n, n)` uint8, one pixel a cell, with the white border of classic families.

    The wheel has to be there and the code has to exist.
    """
    library, family = _drawing(name)
    image = library.apriltag_to_image(family, tag_id)
    try:
        found = image.contents
        rows = np.ctypeslib.as_array(found.pixels, shape=(found.height, found.stride))
        return np.array(rows[:, : found.width], dtype=np.uint8)
    finally:
        library.image_u8_destroy(image)


def _empty(decimate: float, *, refine: bool) -> LibDetector:
    from pyapriltags import Detector as LibDetector

    return LibDetector(families="", nthreads=1, quad_decimate=decimate, refine_edges=int(refine))


@lru_cache(maxsize=16)
def _drawing(name: str) -> tuple[ctypes.CDLL, object]:
    library = _functions(_empty(1.0, refine=False))
    library.apriltag_to_image.restype = ctypes.POINTER(_Image)
    return library, _create(library, name)


def _functions(made: LibDetector) -> ctypes.CDLL:
    assert made.libc is not None
    return made.libc


def _create(library: ctypes.CDLL, name: str) -> object:
    """A family of its own; pyapriltags has told ctypes what its maker returns."""
    return getattr(library, f"{name}_create")()
