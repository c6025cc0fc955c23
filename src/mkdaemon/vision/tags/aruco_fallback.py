"""The search used where the pyapriltags wheel is missing: cv2.aruco with AprilTag dictionaries."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError
from mkdaemon.vision.tags.cellread import read_code
from mkdaemon.vision.tags.detection import Detection, Stage
from mkdaemon.vision.tags.tagfamily import FAMILIES, find_family

Grey = npt.NDArray[np.uint8]


class ArucoSearch:
    """cv2.aruco with sub-pixel corners; its range is short and it is blind to the outer one of nested tags.

    Raises:
        VisionError: a family OpenCV has no dictionary of.
    """

    def __init__(self, families: tuple[str, ...]) -> None:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.cornerRefinementWinSize = 3
        parameters.minMarkerPerimeterRate = 0.02
        self._detectors: dict[str, cv2.aruco.ArucoDetector] = {}
        for name in families:
            dictionary = find_family(name).dictionary
            if dictionary is None:
                msg = f"cv2.aruco does not know {name}: install mkdaemon with its pyapriltags wheel, or use {_known()}"
                raise VisionError(msg)
            codes = cv2.aruco.getPredefinedDictionary(dictionary)
            self._detectors[name] = cv2.aruco.ArucoDetector(codes, parameters)

    def find(self, pixels: Grey, stage: Stage) -> list[Detection]:
        """All codes cv2.aruco sees; `log` equalises the image first, the other stages are one and the same."""
        image = cv2.createCLAHE(4.0, (8, 8)).apply(pixels) if stage == "log" else pixels
        found: list[Detection] = []
        for name, detector in self._detectors.items():
            corners, ids, _ = detector.detectMarkers(np.ascontiguousarray(image))
            # OpenCV returns None for no markers, whatever its type says.
            codes = np.array([] if not corners else ids, dtype=int).ravel()
            for quad, tag_id in zip(corners, codes, strict=True):
                # cv2 names the corners of its own drawing, which is the official print upside down.
                ours = np.roll(np.asarray(quad, dtype=np.float64).reshape(4, 2), 2, axis=0)
                wrong, margin = read_code(pixels, ours, name, int(tag_id), find_family(name).black_cells)
                found.append(Detection(name, int(tag_id), wrong, margin, ours, stage))
        return found


def _known() -> str:
    return ", ".join(family.name for family in FAMILIES.values() if family.dictionary is not None)
