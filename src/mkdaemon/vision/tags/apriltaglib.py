"""libapriltag beyond what pyapriltags wraps: tables of a bearable size, and the library's own drawings of its tags.

pyapriltags corrects two bits of every family, for which libapriltag lists every code with every two bits flipped: 36 MB
for tag36h11, 6 GB for tag52h13. Here large families correct fewer (`TagFamily.corrected_bits`).
"""

from __future__ import annotations

import ctypes
import importlib.util
import threading
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from pyapriltags import Detector as LibDetector

Cells = npt.NDArray[np.uint8]
Families = tuple[tuple[str, int], ...]
"""Names of families and the bits to correct in each."""


class _Image(ctypes.Structure):
    """`image_u8_t` of libapriltag."""

    _fields_ = (
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("stride", ctypes.c_int32),
        ("pixels", ctypes.POINTER(ctypes.c_uint8)),
    )


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


@lru_cache(maxsize=16)
def _drawing(name: str) -> tuple[ctypes.CDLL, object]:
    _, library = _open()
    library.apriltag_to_image.restype = ctypes.POINTER(_Image)
    return library, _family(library, name)


def _open() -> tuple[LibDetector, ctypes.CDLL]:
    """A detector without families, and the functions of the library."""
    from pyapriltags import Detector as LibDetector

    made = LibDetector(families="", nthreads=1, refine_edges=1)
    assert made.libc is not None
    return made, made.libc


def _family(library: ctypes.CDLL, name: str) -> object:
    """A family of its own; pyapriltags has told ctypes what its maker returns."""
    return getattr(library, f"{name}_create")()
