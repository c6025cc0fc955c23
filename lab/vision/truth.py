"""What the search finds in photographs of real tags."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from lab.places import REFERENCE
from lab.vision.parts import Case, Part
from mkdaemon.vision.tags.detector import Detector

PHOTOGRAPHS: Final = REFERENCE / "images"
"""Photographs of real tags beside the checkout; they have their own licences and stay there."""


def _photographs() -> dict[str, Any]:
    if not PHOTOGRAPHS.is_dir():
        return {"skipped": "the photographs are not beside this checkout"}
    return {"labelled": labelled_tags(PHOTOGRAPHS / "apriltag")}


PHOTOGRAPH_CASE: Final = Case(
    lambda _quick, _seeds: [Part(_photographs, (), 10)], lambda _quick, _parts, found: dict(found[0])
)
"""Field photographs with labelled tags, which no seed draws."""


def labelled_tags(folder: Path) -> dict[str, Any]:
    """Find the labelled tags of a folder and compare corners.

    The labels are the output of libapriltag without edge refinement, pixel centres at +0.5, counter-clockwise.
    """
    detector = Detector({"tag36h11": frozenset({0})})
    labels = found = within = extra = 0
    distances: list[float] = []
    for path in sorted(folder.glob("*.jpg")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            continue
        seen = detector.search_all(np.asarray(image, dtype=np.uint8))
        matched = 0
        for line in path.with_suffix(".txt").read_text().splitlines():
            numbers = [float(text) for text in re.findall(r"-?\d+\.?\d*", line)][1:]
            if len(numbers) != 8:
                continue
            labels += 1
            label = np.array(numbers).reshape(4, 2)[[3, 2, 1, 0]] - 0.5
            errors = [np.linalg.norm(item.corners - label, axis=1) for item in seen]
            near = [error for error in errors if error.max() < 5.0]
            if near:
                matched += 1
                distances.extend(float(value) for value in near[0])
                within += bool(np.mean(near[0]) < 0.5)
        found += matched
        extra += len(seen) - matched
    return {
        "labels": labels,
        "found": found,
        "corners_within_half_px": within,
        "unlabelled": extra,
        "median_corner_px": round(float(np.median(distances)), 3) if distances else None,
    }
