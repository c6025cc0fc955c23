"""Thresholds of the self-calibration: value, unit, meaning, and where the figure comes from."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final

from mkdaemon.vision.limitfield import of

MEASURED: Final = "measured, docs/accuracy.md"


@dataclass(frozen=True, slots=True)
class SelfCalLimits:
    """When an image counts, and when a difference is told."""

    period: float = of(0.09, "s", "between images that are looked at", "cost: 1.2 ms each")
    side_px: float = of(40.0, "px", "side of the largest tag from which its edges count", "as `large_tag_px`, farther")
    certain: float = of(4.0, "deviations", "from which a difference is told", MEASURED)
    settled: float = of(0.0065, "share", "deviation of a focal length that little more will move", MEASURED)
    settled_certain: float = of(3.0, "deviations", "from which such a focal length is told", MEASURED)
    least_looks: int = of(20, "images", "before anything is told", "derived: two seconds")
    focal: float = of(0.01, "share", "of the focal length; less is what a calibration leaves", "docs/accuracy.md")
    centre_px: float = of(4.0, "px", "of the principal point", "1.5 cm at 4 m")
    k1: float = of(0.02, "", "of the radial distortion", "0.5 cm at 2 m")
    mounting: float = of(radians(1.0), "rad", "of the mounting; less is the attitude's own bias", "sim: 0.5-1.5 deg")
    size: float = of(0.01, "share", "of a tag's size against the largest tag's", "docs/accuracy.md")
    height: float = of(0.015, "share", "of a way down or up against the barometer's", MEASURED)
    least_way: float = of(0.5, "m", "between the heights that are compared", "steps of a barometer: 5 cm")
    mounting_floor: float = of(radians(0.2), "rad", "deviation of the mounting: slow attitude errors", MEASURED)
    focal_floor: float = of(0.003, "share", "deviation of the focal length that no image shows", MEASURED)
    centre_floor_px: float = of(0.7, "px", "the same of the principal point", MEASURED)
    k1_floor: float = of(0.005, "", "the same of `k1`: a webcam's halo", MEASURED)
    size_floor: float = of(0.002, "share", "the same of a size", MEASURED)
    sheet: float = of(
        0.05, "share", "of the focal length against the data sheet's", "their own tolerance, docs/cameras.md"
    )


SELFCAL: Final = SelfCalLimits()
