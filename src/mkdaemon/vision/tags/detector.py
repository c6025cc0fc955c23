"""Finding tags in an image: a ladder of searches, each accepted only when nothing speaks against the tag.

The search used where the pyapriltags wheel is missing: cv2.aruco with AprilTag dictionaries.

The image as a search sees it: other tones for shadows, tone curves and highlights.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.config.vision import DetectorSection
from mkdaemon.errors import VisionError
from mkdaemon.vision.camera.image import BRIGHTEST
from mkdaemon.vision.limits import LIMITS, Stage
from mkdaemon.vision.tags import apriltaglib
from mkdaemon.vision.tags.cellread import quiet_sides, read_code
from mkdaemon.vision.tags.coderead import Covered
from mkdaemon.vision.tags.detection import Detection, Search
from mkdaemon.vision.tags.outline import OutlineSearch
from mkdaemon.vision.tags.searchplan import (
    FIRST,
    IN_HIGHLIGHTS,
    Look,
    looks_of,
    shrink,
    shrinking,
    with_highlights,
)
from mkdaemon.vision.tags.tagfamily import FAMILIES, find_family

if TYPE_CHECKING:
    from pyapriltags import Detector as LibDetector

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


_LOG_LUT: Grey = np.round(100 + 14 * (np.log10(np.arange(256) + 4.0) - np.log10(64.0))).clip(0, 255).astype(np.uint8)
"""Compresses bright and dark halves of a shadow to equal steps; 14 levels a decade merge texture below a real edge."""

_LIGHT_LUT: Grey = np.round(255 * (np.arange(256) / 255) ** LIMITS.search.tone).astype(np.uint8)
"""Light from grey values: a tone curve lets white cells spread over small black ones, which then read as white."""

_BRIGHT_LUT: Grey = np.round(255 * (np.arange(256) / 255) ** LIMITS.search.highlight).astype(np.uint8)
"""Spreads the brightest grey values: ink in a highlight is nearly as bright as paper beside it."""


def prepare(pixels: Grey, stage: Stage) -> npt.NDArray[np.generic]:
    """The image a stage searches `(h, w)`, 8 bits.

    Args:
        pixels: `(h, w)` uint8.
        stage: how it is searched.
    """
    if stage in ("log", "halflog"):
        return cv2.LUT(pixels, _LOG_LUT)
    if stage == "linear":
        return cv2.LUT(pixels, _LIGHT_LUT)
    if stage == "bright":
        return cv2.LUT(pixels, _BRIGHT_LUT)
    return pixels


BROKEN: tuple[Stage, ...] = ("outline", "highlight")
"""Searches for broken outlines."""
SIDES = 4
"""Of a tag; all of them have to be quiet."""
AROUND = 0.3
"""Room around a tag that is searched for again, share of its side: its quiet zone and a cell more."""
ARUCO_LADDER: tuple[Stage, ...] = ("decimate1", "log", "outline")
"""Searches without libapriltag."""

LOST_WITHOUT_APRILTAG = (
    "pyapriltags is not installed: tags are searched with cv2.aruco, which loses range (4 m instead of 10 m for a"
    " 12 inch tag on VGA), corner precision (0.2-0.5 px instead of 0.02 px), hard shadows and the outer one of nested"
    " tags; install mkdaemon with its pyapriltags wheel"
)


class AprilTagSearch:
    """libapriltag through pyapriltags, in one thread.

    pyapriltags carries upstream's fix of `refine_edges`, which pupil-apriltags and dt-apriltags lack.
    """

    def __init__(self, families: tuple[str, ...]) -> None:
        self._families = tuple((name, find_family(name).corrected_bits) for name in families)

    def find(self, pixels: Grey, stage: Stage) -> list[Detection]:
        """All codes libapriltag sees, in our corner order and pixel convention."""
        image = np.asarray(prepare(pixels, stage), dtype=np.uint8, order="C")
        decimate = 2.0 if stage in FIRST else 1.0
        return self._read(apriltaglib.detector(self._families, decimate, refine=True), image, stage)

    @staticmethod
    def _read(lib: LibDetector, image: Grey, stage: Stage) -> list[Detection]:
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
            for item in lib.detect(image)
        ]


class Detector:
    """Searches images for the tags of a whitelist.

    Attributes:
        backend: `apriltag` or, without its wheel, `aruco`.
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
        self._whitelist = {find_family(name).name: ids for name, ids in whitelist.items()}
        self._cfg = cfg or DetectorSection()
        if backend == "auto":
            backend = "apriltag" if apriltaglib.is_installed() else "aruco"
        self.backend = backend
        self.warning = LOST_WITHOUT_APRILTAG if backend == "aruco" else ""
        families = tuple(self._whitelist)
        self._max_hamming = {name: self._allowed_hamming(name, len(ids)) for name, ids in self._whitelist.items()}
        self._search: Search = AprilTagSearch(families) if backend == "apriltag" else ArucoSearch(families)
        classic = {name: ids for name, ids in self._whitelist.items() if not find_family(name).is_inverted}
        self._outline = OutlineSearch(classic, covered or {})
        self.stages: tuple[Stage, ...] = LIMITS.search.ladder if backend == "apriltag" else ARUCO_LADDER
        self._in_highlights = IN_HIGHLIGHTS
        if not classic:
            # They start from the outline of something black, and an inverted tag has data there.
            self.stages = tuple(stage for stage in self.stages if stage not in BROKEN)
            self._in_highlights = tuple(stage for stage in IN_HIGHLIGHTS if stage not in BROKEN)

    def search(self, pixels: Grey, stage: Stage, roi: tuple[int, int, int, int] | None = None) -> list[Detection]:
        """Run one search.

        Args:
            pixels: `(h, w)` uint8.
            stage: which search.
            roi: `(x0, y0, x1, y1)` [px], end exclusive; the whole image when absent.

        Returns:
            Tags that passed every check, at most one per code: the one with the clearest bits.
        """
        height, width = pixels.shape
        x0, y0, x1, y1 = frame = roi or (0, 0, width, height)
        part = pixels[y0:y1, x0:x1]
        best: dict[tuple[str, int], Detection] = {}
        for found in self._find(part, stage):
            moved = replace(found, corners=found.corners + np.array([x0, y0]))
            key = (moved.family, moved.tag_id)
            if (key not in best or _rank(moved) > _rank(best[key])) and self._accepts(pixels, moved, frame):
                best[key] = moved
        return list(best.values())

    def search_shrunk(
        self, pixels: Grey, stage: Stage, roi: tuple[int, int, int, int] | None = None
    ) -> list[Detection]:
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
        return next((found for found in sharper if (found.family, found.tag_id) == (tag.family, tag.tag_id)), tag)

    def search_all(self, pixels: Grey, stage: Stage = "decimate1") -> list[Detection]:
        """Every accepted tag of one search, also several with the same code."""
        frame = (0, 0, pixels.shape[1], pixels.shape[0])
        return [tag for tag in self._find(pixels, stage) if self._accepts(pixels, tag, frame)]

    def looks(self, pixels: Grey) -> tuple[Look, ...]:
        """The searches of an image that take turns beside the first ones, those in highlights where much is blown."""
        height, width = pixels.shape
        looks = looks_of(width, height, self.stages)
        if np.count_nonzero(pixels >= LIMITS.read.saturated) < LIMITS.search.highlight_px:
            return looks
        return with_highlights(looks, self._in_highlights)

    def _find(self, pixels: Grey, stage: Stage) -> list[Detection]:
        """What one search sees; nothing in a few rows, on which libapriltag crashes."""
        if min(pixels.shape) < LIMITS.search.min_window_px:
            return []
        if stage == "outline":
            return self._outline.find(pixels, stage)
        if stage == "highlight":
            return self._outline.find_in_highlight(pixels, stage)
        return self._search.find(pixels, stage)

    def _allowed_hamming(self, name: str, ids: int) -> int:
        """Most corrected bits that keep the chance of a random quad within bounds (four rotations, all codes)."""
        family = find_family(name)
        bits = family.bits
        allowed, words = 0, 1
        for distance in range(1, min(self._cfg.max_hamming, family.corrected_bits) + 1):
            words += math.comb(bits, distance)
            false_rate = SIDES * ids * words / 2**bits  # a quad may be turned any way
            if false_rate > self._cfg.max_false_rate:
                break
            allowed = distance
        return allowed

    def _accepts(self, pixels: Grey, found: Detection, frame: tuple[int, int, int, int]) -> bool:
        """Whitelist, bits, margins and quiet zone."""
        cfg = self._cfg
        if found.tag_id not in self._whitelist.get(found.family, frozenset()):
            return False
        # A broken outline was judged by the chance of its code: wrong cells may be covered ones, as may the quiet zone.
        broken = found.stage in BROKEN
        if found.hamming > self._max_hamming[found.family] * (2 if broken else 1):
            return False
        # Other images than the camera's have contrast on their own scale; hamming and quiet zone judge the bits there.
        margin = cfg.min_decision_margin * _contrast_share(pixels, found)
        if found.stage in ("decimate1", "decimate2") and found.decision_margin < margin:
            return False
        low, high = found.corners.min(axis=0), found.corners.max(axis=0)
        x0, y0, x1, y1 = frame
        if (low < (x0 + cfg.margin_px, y0 + cfg.margin_px)).any():
            return False
        if (high > (x1 - 1 - cfg.margin_px, y1 - 1 - cfg.margin_px)).any():
            return False
        if broken or not cfg.quiet_zone:
            return True
        family = find_family(found.family)
        return quiet_sides(pixels, found.corners, family.size_cells, inverted=family.is_inverted) == SIDES


def _rank(found: Detection) -> tuple[int, float]:
    return -found.hamming, found.decision_margin


def _contrast_share(pixels: Grey, found: Detection) -> float:
    """Scale of the margin where a tag has less than all grey values."""
    x0, y0 = np.maximum(found.corners.min(axis=0).astype(int), 0)
    x1, y1 = found.corners.max(axis=0).astype(int) + 1
    part = pixels[y0:y1, x0:x1]
    if part.size == 0:
        return 1.0
    return float(int(part.max()) - int(part.min())) / BRIGHTEST
