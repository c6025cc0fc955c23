"""Finding tags in an image by a ladder of searches; what they find counts only where chance hardly explains it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final, Literal

import cv2
import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Grey
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags import apriltaglib
from mkdaemon.vision.tags.cellread import TURNS, Covered, chance, has_sides, read_code
from mkdaemon.vision.tags.detection import Detection, best_of_codes
from mkdaemon.vision.tags.outline import OutlineSearch, has_highlights
from mkdaemon.vision.tags.searchplan import FIRST, LADDER, Look, Part, Stage, looks_of, shrink, shrinking
from mkdaemon.vision.tags.tagfamily import OPENCV_KNOWS, find_family

_LOG: Final[Grey] = np.round(100 + 14 * (np.log10(np.arange(256) + 4.0) - np.log10(64.0))).clip(0, 255).astype(np.uint8)
"""Compresses bright and dark halves of a shadow to equal steps; 14 levels a decade merge texture below a real edge."""
_LIGHT: Final[Grey] = np.round(255 * (np.arange(256) / 255) ** LIMITS.search.tone).astype(np.uint8)
"""Light from grey values: a tone curve lets white cells spread over small black ones, which then read as white."""
TONES: Final[Mapping[Stage, Grey]] = {"linear": _LIGHT, "halflog": _LOG, "log": _LOG}
"""What is seen in place of each grey value; the other stages see the image as it is."""
LOST_WITHOUT_APRILTAG: Final = (
    "pyapriltags is not installed: tags are searched with cv2.aruco, which loses range (4 m instead of 10 m for a"
    " 12 inch tag on VGA), corner precision (0.2-0.5 px instead of 0.02 px), hard shadows and the outer one of nested"
    " tags; install mkdaemon with its pyapriltags wheel"
)


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
                msg = (
                    f"cv2.aruco does not know {name}: install mkdaemon with its pyapriltags wheel, or use"
                    f" {OPENCV_KNOWS}"
                )
                raise VisionError(msg)
            codes = cv2.aruco.getPredefinedDictionary(dictionary)
            self._detectors[name] = cv2.aruco.ArucoDetector(codes, parameters)

    def find(self, pixels: Grey, stage: Stage) -> list[Detection]:
        """All codes cv2.aruco sees, in our corner order."""
        found: list[Detection] = []
        for name, detector in self._detectors.items():
            corners, ids, _ = detector.detectMarkers(np.ascontiguousarray(pixels))
            # OpenCV returns None for no markers, whatever its type says.
            codes = np.array([] if not corners else ids, dtype=int).ravel()
            for quad, tag_id in zip(corners, codes, strict=True):
                # cv2 names the corners of its own drawing, which is the official print upside down.
                ours = np.roll(np.asarray(quad, dtype=np.float64).reshape(4, 2), 2, axis=0)
                wrong, margin = read_code(pixels, ours, name, int(tag_id))
                found.append(Detection(name, int(tag_id), wrong, margin, ours, stage))
        return found


class AprilTagSearch:
    """libapriltag through pyapriltags, in one thread.

    pyapriltags carries upstream's fix of `refine_edges`, which pupil-apriltags and dt-apriltags lack.
    """

    def __init__(self, families: tuple[str, ...]) -> None:
        self._families = tuple((name, find_family(name).corrected_bits) for name in families)

    def find(self, pixels: Grey, stage: Stage, shrunk: int = 1) -> list[Detection]:
        """All codes libapriltag sees, in our corner order and pixel convention.

        Args:
            pixels: `(h, w)` uint8.
            stage: which search.
            shrunk: by how much the image is shrunk to find quads; edges and cells are those of the whole one.
        """
        library = apriltaglib.detector(self._families, shrunk * (2.0 if stage in FIRST else 1.0))
        return [
            Detection(
                family=item.tag_family.decode(),
                tag_id=item.tag_id,
                hamming=item.hamming,
                decision_margin=float(item.decision_margin),
                # libapriltag: counter-clockwise from the print's bottom-left, pixel centres at +0.5.
                corners=item.corners[[3, 2, 1, 0]] - 0.5,
                stage=stage,
            )
            for item in library.detect(np.asarray(pixels, dtype=np.uint8, order="C"))
        ]


class Detector:
    """Searches images for the tags of a whitelist.

    Attributes:
        backend: `apriltag` or, without its wheel, `aruco`.
        stages: its searches of the whole image.
        warning: what the fallback loses; empty with `apriltag`.
    """

    def __init__(
        self,
        whitelist: Mapping[str, frozenset[int]],
        *,
        max_chance: float = LIMITS.read.max_chance,
        backend: Literal["auto", "apriltag", "aruco"] = "auto",
        covered: Covered | None = None,
    ) -> None:
        """Prepare the searches.

        Args:
            whitelist: ids by family.
            max_chance: that a random quad reads as one of them, where cells read wrong or not at all.
            backend: which library; `auto` takes the best that is installed.
            covered: cells that another tag lies on (`cover.covered_cells`); a broken outline is read without them.

        Raises:
            VisionError: an unknown family, or one that only pyapriltags can search for, without its wheel.
        """
        if backend == "auto":
            backend = "apriltag" if apriltaglib.is_installed() else "aruco"
        self.backend = backend
        self.warning = LOST_WITHOUT_APRILTAG if backend == "aruco" else ""
        self._whitelist, self._max_chance = whitelist, max_chance
        families = tuple(whitelist)
        self._whole = AprilTagSearch(families) if backend == "apriltag" else ArucoSearch(families)
        # Outlines are those of something black, and an inverted tag has data there.
        classic = {name: ids for name, ids in whitelist.items() if not find_family(name).is_inverted}
        self._broken = OutlineSearch(classic, covered or {})
        self.stages: tuple[Stage, ...] = tuple(stage for stage in LADDER if classic or stage != "outline")

    def looks(self, pixels: Grey) -> tuple[Look, ...]:
        """The searches of an image that take turns beside the first ones, in highlights that for outlines first."""
        height, width = pixels.shape
        stages = sorted(self.stages, key=lambda stage: stage != "outline") if has_highlights(pixels) else self.stages
        return looks_of(width, height, tuple(stages))

    def search(self, pixels: Grey, stage: Stage, part: Part | None = None) -> list[Detection]:
        """Run one search at a bounded cost: a large part is shrunk.

        Args:
            pixels: `(h, w)` uint8.
            stage: which search.
            part: of the image; the whole of it where it is none.

        Returns:
            Tags that are believed, at most one per code: the one with the clearest bits.
        """
        height, width = pixels.shape
        x0, y0, x1, y1 = part or (0, 0, width, height)
        found = self.search_all(pixels, stage, part, shrunk=shrinking(x1 - x0, y1 - y0))
        return best_of_codes(found, lambda tag: (-tag.hamming, tag.decision_margin))

    def search_all(
        self, pixels: Grey, stage: Stage = "decimate1", part: Part | None = None, *, shrunk: int = 1
    ) -> list[Detection]:
        """Every tag of one search that is believed, also several with the same code; see `search`."""
        height, width = pixels.shape
        x0, y0, x1, y1 = part or (0, 0, width, height)
        seen = pixels[y0:y1, x0:x1]
        if min(seen.shape) < LIMITS.search.min_window_px * shrunk:
            return []  # libapriltag crashes on a few rows
        if stage in TONES:
            seen = np.asarray(cv2.LUT(seen, TONES[stage]), dtype=np.uint8)
        # centres of pixels are whole numbers: the middle of the first block is at (shrunk - 1) / 2
        scale, first = shrunk, np.array([x0, y0]) + (shrunk - 1) / 2
        if stage == "outline":
            found = self._broken.find(shrink(seen, shrunk))
        elif isinstance(self._whole, ArucoSearch):
            found = self._whole.find(shrink(seen, shrunk), stage)
        else:
            found, scale, first = self._whole.find(seen, stage, shrunk), 1, np.array([x0, y0])
        placed = (replace(tag, corners=scale * tag.corners + first, shrunk=scale) for tag in found)
        return [tag for tag in placed if self._is_believed(pixels, tag)]

    def _is_believed(self, pixels: Grey, found: Detection) -> bool:
        """Whether a tag is wanted, and explained by chance less often than allowed; and whole where that was taken."""
        ids, family = self._whitelist.get(found.family, frozenset()), find_family(found.family)
        if found.tag_id not in ids:
            return False
        if found.hamming > 0 and chance(family.bits, found.hamming, TURNS * len(ids)) > self._max_chance:
            return False
        is_open = found.stage == "outline"
        return is_open or has_sides(pixels, found.corners, family.size_cells, inverted=family.is_inverted)
