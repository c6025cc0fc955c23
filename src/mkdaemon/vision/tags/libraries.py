"""The libraries that search for unbroken tags: libapriltag, and cv2.aruco where its wheel is not installed."""

from __future__ import annotations

import threading
from typing import Any, Final

import cv2
import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.tags.cellread import read_code
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.tagfamily import OPENCV_KNOWS, family_in, find_family, open_library

LOST_WITHOUT_APRILTAG: Final = (
    "pyapriltags is not installed: tags are searched with cv2.aruco, which loses range (4 m instead of 10 m for a"
    " 12 inch tag on VGA), corner precision (0.2-0.5 px instead of 0.02 px), hard shadows and the outer one of nested"
    " tags; install mkdaemon with its pyapriltags wheel"
)
_of_thread = threading.local()
"""Libraries this thread has opened, by their families."""


class AprilTagSearch:
    """libapriltag through pyapriltags, in one thread.

    pyapriltags carries upstream's fix of `refine_edges`, which pupil-apriltags and dt-apriltags lack. It corrects two
    bits of every family: 36 MB for tag36h11, 6 GB for tag52h13. Here large families correct fewer.
    """

    def __init__(self, families: tuple[str, ...]) -> None:
        self._families = families

    @property
    def library(self) -> Any:
        """The library with its tables; they take time and serve one thread, whose searches share them."""
        of_thread, key = vars(_of_thread), " ".join(self._families)
        if key not in of_thread:
            opened = open_library()
            for name in self._families:
                family, bits = family_in(opened, name), find_family(name).corrected_bits
                opened.libc.apriltag_detector_add_family_bits(opened.tag_detector_ptr, family, bits)
            of_thread[key] = opened
        return of_thread[key]

    def find(self, pixels: Grey, decimate: float = 1.0) -> list[Detection]:
        """All codes libapriltag sees, in our corner order and pixel convention.

        Args:
            pixels: `(h, w)` uint8.
            decimate: quads are found in an image so much smaller; edges and cells are those of the whole one.
        """
        library = self.library
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


class ArucoSearch:
    """cv2.aruco with sub-pixel corners; its range is short and it is blind to the outer one of nested tags.

    Raises:
        VisionError: a family OpenCV has no dictionary of.
    """

    def __init__(self, families: tuple[str, ...]) -> None:
        self._families, codes = families, []
        for name in families:
            dictionary = find_family(name).dictionary
            if dictionary is None:
                msg = (
                    f"cv2.aruco does not know {name}: install mkdaemon with its pyapriltags wheel, or use"
                    f" {OPENCV_KNOWS}"
                )
                raise VisionError(msg)
            codes.append(cv2.aruco.getPredefinedDictionary(dictionary))
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.cornerRefinementWinSize = 3
        parameters.minMarkerPerimeterRate = 0.02
        self._detector = cv2.aruco.ArucoDetector(codes, parameters)

    def find(self, pixels: Grey) -> list[Detection]:
        """All codes cv2.aruco sees in `(h, w)` uint8, in our corner order."""
        corners, ids, _, which = self._detector.detectMarkersMultiDict(np.ascontiguousarray(pixels))
        found: list[Detection] = []
        # OpenCV returns None for no markers.
        for quad, tag_id, k in zip(corners, np.ravel(ids), np.ravel(which), strict=False):
            # cv2 names the corners of its own drawing, which is the official print upside down.
            ours = np.roll(np.asarray(quad, dtype=np.float64).reshape(4, 2), 2, axis=0)
            name = self._families[int(k)]
            found.append(Detection(name, int(tag_id), *read_code(pixels, ours, name, int(tag_id)), ours))
        return found
