"""A file of another program, and calibrations of cameras as other programs write them."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mkdaemon.vision.camera.calibration_file import load_camera

BOM: Final = "\ufeff"


@dataclass(frozen=True, slots=True)
class Foreign:
    """One file of another program.

    Attributes:
        suffix: of its name.
        content: what stands in it.
        fault: what is wrong with how it was read, given its path; empty for nothing.
        is_right: nothing in it can be refused.
    """

    suffix: str
    content: bytes
    fault: Callable[[Path], str]
    is_right: bool = False


def marked(rng: random.Random, text: str) -> bytes:
    """A text in UTF-8, sometimes with a mark of the byte order."""
    return ((BOM if rng.random() < 0.3 else "") + text).encode()


def _coefficients(rng: random.Random, counts: list[int]) -> list[float]:
    return [round(rng.uniform(-0.1, 0.1), 4) for _ in range(rng.choice(counts))]


def _camera(suffix: str, content: bytes, focal: float, coefficients: list[float], kept: int) -> Foreign:
    """A calibration with a focal length, and coefficients of which a camera file keeps so many."""

    def fault(path: Path) -> str:
        found = load_camera(path).intrinsics
        wanted = [*coefficients, *[0.0] * kept][:kept]
        right = found.fx == focal and not any(coefficients[kept:]) and list(found.distortion) == wanted
        return "" if right and (found.width, found.height) == (640, 480) else f"{found} is not {coefficients}"

    return Foreign(suffix, content, fault, math.isfinite(focal) and focal > 0 and not any(coefficients[kept:]))


def ros(rng: random.Random) -> Foreign:
    """Of ROS's `camera_calibration`."""
    model = rng.choice(["plumb_bob", "rational_polynomial", "equidistant"])
    coefficients, focal = _coefficients(rng, [4, 5, 8]), rng.choice([500.0, 601.25, float("nan")])
    text = (
        "image_width: 640\nimage_height: 480\n"
        f"camera_matrix:\n  rows: 3\n  data: [{focal}, 0, 320, 0, 600, 240, 0, 0, 1]\n"
        f"distortion_model: {model}\ndistortion_coefficients:\n  cols: {len(coefficients)}\n  data: {coefficients}\n"
    )
    return _camera(".yaml", marked(rng, text), focal, coefficients, 4 if model == "equidistant" else 5)


def ost(rng: random.Random) -> Foreign:
    """The same in its older form."""
    coefficients, focal = _coefficients(rng, [4, 5, 8]), rng.choice([500.0, 601.25, float("inf")])
    row = " ".join(f"{value:.6f}" for value in coefficients)
    end = rng.choice(["\n", "\r\n"])
    text = (
        "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n[narrow_stereo]\n\n"
        f"camera matrix\n{focal:.6f} 0.000000 320.000000\n0.000000 600.000000 240.000000\n"
        f"0.000000 0.000000 1.000000\n\ndistortion\n{row}\n\nrectification\n1.0 0.0 0.0\n0.0 1.0 0.0\n0.0 0.0 1.0\n"
    )
    return _camera(".txt", marked(rng, text.replace("\n", end)), focal, coefficients, 5)


def kalibr(rng: random.Random) -> Foreign:
    """Of Kalibr: perhaps several cameras, or a lens that nobody here knows."""
    model = rng.choice(["radtan", "equidistant", "fov"])
    coefficients, focal = _coefficients(rng, [4]), rng.choice([500.0, 601.25, float("nan")])
    rows = "".join(f"\n  - {value}" for value in coefficients) if rng.random() < 0.5 else f" {coefficients}"
    text = "".join(
        f"cam{number}:\n  cam_overlaps: []\n  camera_model: {rng.choice(['pinhole', 'pinhole', 'omni'])}\n"
        f"  distortion_coeffs:{rows}\n  distortion_model: {model}\n"
        f"  intrinsics: [{focal}, 600.0, 320.0, 240.0]\n  resolution: [640, 480]\n  rostopic: /cam{number}/image_raw\n"
        for number in range(rng.choice([1, 1, 1, 2]))
    )
    # Several cameras, an omnidirectional one and a lens that nobody here knows have to be refused.
    is_right = "cam1" not in text and "omni" not in text and model != "fov"
    kept = 4 if model == "equidistant" else 5
    return _camera(".yaml", marked(rng, text), focal if is_right else -1.0, coefficients, kept)
