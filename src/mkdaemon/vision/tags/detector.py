"""Finding tags in an image by a ladder of searches; what they find counts only when nothing speaks against the tag."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, Literal

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import DetectorSection
from mkdaemon.errors import VisionError
from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags import apriltaglib
from mkdaemon.vision.tags.cellread import quiet_sides, read_code
from mkdaemon.vision.tags.coderead import Covered
from mkdaemon.vision.tags.detection import Detection, best_of_codes
from mkdaemon.vision.tags.outline import OutlineSearch, has_highlights
from mkdaemon.vision.tags.searchplan import ARUCO_LADDER, FIRST, LADDER, Look, Part, Stage, looks_of, shrink, shrinking
from mkdaemon.vision.tags.tagfamily import OPENCV_KNOWS, find_family

Grey = npt.NDArray[np.uint8]

AROUND: Final = 0.3
"""Room around a tag that is searched for again, share of its side: its quiet zone and a cell more."""
_LOG: Final[Grey] = np.round(100 + 14 * (np.log10(np.arange(256) + 4.0) - np.log10(64.0))).clip(0, 255).astype(np.uint8)
"""Compresses bright and dark halves of a shadow to equal steps; 14 levels a decade merge texture below a real edge."""
_LIGHT: Final[Grey] = np.round(255 * (np.arange(256) / 255) ** LIMITS.search.tone).astype(np.uint8)
"""Light from grey values: a tone curve lets white cells spread over small black ones, which then read as white."""
TONES: Final[Mapping[Stage, Grey]] = {"linear": _LIGHT, "halflog": _LOG, "log": _LOG}
"""What libapriltag sees in place of each grey value; the other stages see the image as it is."""
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
                wrong, margin = read_code(pixels, ours, name, int(tag_id))
                found.append(Detection(name, int(tag_id), wrong, margin, ours, stage))
        return found


class AprilTagSearch:
    """libapriltag through pyapriltags, in one thread.

    pyapriltags carries upstream's fix of `refine_edges`, which pupil-apriltags and dt-apriltags lack.
    """

    def __init__(self, families: tuple[str, ...]) -> None:
        self._families = tuple((name, find_family(name).corrected_bits) for name in families)

    def find(self, pixels: Grey, stage: Stage) -> list[Detection]:
        """All codes libapriltag sees, in our corner order and pixel convention."""
        seen = cv2.LUT(pixels, TONES[stage]) if stage in TONES else pixels
        library = apriltaglib.detector(self._families, 2.0 if stage in FIRST else 1.0)
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
            for item in library.detect(np.asarray(seen, dtype=np.uint8, order="C"))
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
        cfg: DetectorSection | None = None,
        *,
        backend: Literal["auto", "apriltag", "aruco"] = "auto",
        covered: Covered | None = None,
    ) -> None:
        """Prepare the searches.

        Args:
            whitelist: ids by family.
            cfg: settings.
            backend: which library; `auto` takes the best that is installed.
            covered: cells that another tag lies on (`cover.covered_cells`); a broken outline is read without them.

        Raises:
            VisionError: an unknown family, or one that only pyapriltags can search for, without its wheel.
        """
        self._cfg = cfg or DetectorSection()
        if backend == "auto":
            backend = "apriltag" if apriltaglib.is_installed() else "aruco"
        self.backend = backend
        self.warning = LOST_WITHOUT_APRILTAG if backend == "aruco" else ""
        self._whitelist = whitelist
        self._max_hamming = {name: self._allowed_hamming(name, len(ids)) for name, ids in whitelist.items()}
        families = tuple(whitelist)
        self._whole = AprilTagSearch(families) if backend == "apriltag" else ArucoSearch(families)
        # Outlines are those of something black, and an inverted tag has data there.
        classic = {name: ids for name, ids in whitelist.items() if not find_family(name).is_inverted}
        self._broken = OutlineSearch(classic, covered or {})
        ladder = LADDER if backend == "apriltag" else ARUCO_LADDER
        self.stages: tuple[Stage, ...] = tuple(stage for stage in ladder if classic or stage != "outline")

    def looks(self, pixels: Grey) -> tuple[Look, ...]:
        """The searches of an image that take turns beside the first ones, in highlights that for outlines first."""
        height, width = pixels.shape
        stages = sorted(self.stages, key=lambda stage: stage != "outline") if has_highlights(pixels) else self.stages
        return looks_of(width, height, tuple(stages))

    def search(self, pixels: Grey, stage: Stage, roi: Part | None = None) -> list[Detection]:
        """Run one search.

        Args:
            pixels: `(h, w)` uint8.
            stage: which search.
            roi: the whole image when absent.

        Returns:
            Tags that passed every check, at most one per code: the one with the clearest bits.
        """
        return best_of_codes(self.search_all(pixels, stage, roi), lambda tag: (-tag.hamming, tag.decision_margin))

    def search_shrunk(self, pixels: Grey, stage: Stage, roi: Part | None = None) -> list[Detection]:
        """Run one search on a part that is shrunk where it is large, and again around what it found; see `search`."""
        height, width = pixels.shape
        x0, y0, x1, y1 = roi or (0, 0, width, height)
        scale = shrinking(x1 - x0, y1 - y0)
        if scale <= 1:
            return self.search(pixels, stage, roi)
        found = self.search(shrink(pixels[y0:y1, x0:x1], scale), stage)
        # centres of pixels are whole numbers: the middle of the first block is at (scale - 1) / 2
        first = np.array([x0, y0]) + (scale - 1) / 2
        placed = [replace(tag, corners=tag.corners * scale + first, shrunk=scale) for tag in found]
        return [self._search_again(pixels, tag) for tag in placed]

    def _search_again(self, pixels: Grey, tag: Detection) -> Detection:
        """A tag of a shrunk image with the corners of a less shrunk one, where it is found there."""
        height, width = pixels.shape
        room = AROUND * tag.side_px + self._cfg.margin_px + 1
        x0, y0 = np.maximum(tag.corners.min(axis=0) - room, 0).astype(int).tolist()
        x1, y1 = np.minimum(tag.corners.max(axis=0) + room + 1, (width, height)).astype(int).tolist()
        if shrinking(x1 - x0, y1 - y0) >= tag.shrunk:
            return tag
        sharper = self.search_shrunk(pixels, tag.stage, (x0, y0, x1, y1))
        return next((found for found in sharper if found.code == tag.code), tag)

    def search_all(self, pixels: Grey, stage: Stage = "decimate1", roi: Part | None = None) -> list[Detection]:
        """Every accepted tag of one search, also several with the same code; see `search`."""
        height, width = pixels.shape
        x0, y0, x1, y1 = part = roi or (0, 0, width, height)
        seen = pixels[y0:y1, x0:x1]
        if min(seen.shape) < LIMITS.search.min_window_px:
            return []  # libapriltag crashes on a few rows
        found = self._broken.find(seen) if stage == "outline" else self._whole.find(seen, stage)
        placed = (replace(tag, corners=tag.corners + np.array([x0, y0])) for tag in found)
        return [tag for tag in placed if self._accepts(pixels, tag, part)]

    def _allowed_hamming(self, name: str, ids: int) -> int:
        """Most corrected bits that keep the chance of a random quad within bounds (four rotations, all codes)."""
        family = find_family(name)
        allowed, words = 0, 1
        for distance in range(1, min(self._cfg.max_hamming, family.corrected_bits) + 1):
            words += math.comb(family.bits, distance)
            if 4 * ids * words / 2**family.bits > self._cfg.max_false_rate:
                break
            allowed = distance
        return allowed

    def _accepts(self, pixels: Grey, found: Detection, part: Part) -> bool:
        """Whitelist, bits, place in the searched part, margin and quiet zone."""
        cfg = self._cfg
        if found.tag_id not in self._whitelist.get(found.family, ()):
            return False
        # A broken outline was judged by the chance of its code: wrong cells may be covered ones, as may the quiet zone.
        is_broken = found.stage == "outline"
        if found.hamming > self._max_hamming[found.family] * (2 if is_broken else 1):
            return False
        low, high = found.corners.min(axis=0), found.corners.max(axis=0)
        first, last = np.array(part[:2]), np.array(part[2:]) - 1
        if (low < first + cfg.margin_px).any() or (high > last - cfg.margin_px).any():
            return False
        if found.stage in ("decimate1", "decimate2"):
            # In other tones contrast has a scale of its own; hamming and quiet zone judge the bits there.
            (x0, y0), (x1, y1) = low.astype(int), high.astype(int) + 1
            own = pixels[y0:y1, x0:x1]
            contrast = (int(own.max()) - int(own.min())) / BRIGHTEST
            if found.decision_margin < cfg.min_decision_margin * contrast:
                return False
        if is_broken or not cfg.quiet_zone:
            return True
        family = find_family(found.family)
        return quiet_sides(pixels, found.corners, family.size_cells, inverted=family.is_inverted) == 4
