"""Whether the covariance is honest, and what real photographs say."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from lab.places import REFERENCE
from lab.vision.flight import VGA
from lab.vision.lens import drawn_lens
from lab.vision.parts import Case, Part, in_parts
from lab.vision.stills import SeedSet, Studio, error_of, look_once, target_named
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.pose import Pose, solve
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.still import StillEye
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import single

Array = npt.NDArray[np.float64]

PHOTOGRAPHS: Final = REFERENCE / "images"
"""Photographs of real tags beside the checkout; they have their own licences and stay there."""
ROTATION_CAMERA: Final = Intrinsics(width=1056, height=792, fx=329.873, fy=332.946, cx=528.0, cy=396.0, line_time=0.0)
"""Of the rotation series, as published with it."""
ROTATION_TAG_M: Final = 0.065


def _plan_nees(quick: bool, seeds: SeedSet) -> list[Part]:
    each, size = (30, 15) if quick else (200, 50)
    return [
        Part(_nees, (f"{name}_{target}", target, name == "published", count, seeds.base + 700, 100 * k + part), count)
        for k, (name, target) in enumerate(itertools.product(("measurement", "published"), ("single", "nested")))
        for part, count in in_parts(each, size)
    ]


def _nees(_name: str, target_name: str, perturbed: bool, count: int, seed: int, part: int) -> list[float]:
    """NEES per degree of freedom of poses; the published covariance is asked about a drawn lens."""
    target = target_named(target_name)
    studio = Studio(target, seed, part=part)
    values = []
    for _ in range(count):
        rng = studio.rng
        lens = drawn_lens(VGA, rng) if perturbed else None
        still = studio.shoot(float(rng.uniform(0.6, 8.0)), float(rng.uniform(0, 0.9)), lens=lens)
        found = look_once(still, target, VGA, with_attitude=False).pose_of(target.name)
        if found is None:
            continue
        error = error_of(found.pose.rotation, found.pose.position, still.rotation, still.position)
        vector = np.array([*error.xyz, *error.rpy])
        covariance = found.covariance if perturbed else found.pose.covariance
        values.append(float(vector @ np.linalg.solve(covariance, vector)) / 6)
    return values


def _sum_up_nees(quick: bool, parts: Sequence[Part], found: Sequence[list[float]]) -> dict[str, Any]:
    each = 30 if quick else 200
    out: dict[str, Any] = {"images_each": each}
    for name in dict.fromkeys(part.args[0] for part in parts):
        values = [v for part, some in zip(parts, found, strict=True) if part.args[0] == name for v in some]
        out[name] = {
            "posed": len(values) / each,
            "nees_per_dof": round(float(np.mean(values)), 3) if values else None,
            "median": round(float(np.median(values)), 3) if values else None,
        }
    return out


CONSISTENCY: Final = Case(_plan_nees, _sum_up_nees)
"""NEES per degree of freedom: of the measurement with an exact lens, of the published one with a drawn lens."""


def _photographs() -> dict[str, Any]:
    if not PHOTOGRAPHS.is_dir():
        return {"skipped": "the photographs are not beside this checkout"}
    return {"labelled": labelled_tags(PHOTOGRAPHS / "apriltag"), "rotation": rotation_series(PHOTOGRAPHS / "rotation")}


PHOTOGRAPH_CASE: Final = Case(
    lambda _quick, _seeds: [Part(_photographs, (), 10)], lambda _quick, _parts, found: dict(found[0])
)
"""Field photographs with labelled tags, and the rotation series; neither is drawn from a seed."""


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


def rotation_series(folder: Path) -> dict[str, Any]:
    """Deviation of measured steps of nominally 20 degrees, each image measured alone with the published camera.

    The images leave residuals of half a pixel with that camera, which vanish with another ratio of the focal lengths:
    stills weigh such a residual against what a calibration knows of the ratio. `exact_camera` holds the figures of fits
    that take the published camera as exact.
    """
    eye = StillEye(tag_size=ROTATION_TAG_M)
    tags: set[int] = set()
    poses: dict[int, Pose] = {}
    exact: dict[int, Pose] = {}
    for path in sorted(folder.glob("test_image_rotation_*.png")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            continue
        pixels = np.asarray(image, dtype=np.uint8)
        seen = [tag for tag in eye.look(pixels, ROTATION_CAMERA).tags if tag.pose is not None]
        if not seen:
            continue
        tag = max(seen, key=lambda item: item.found.side_px)
        tags.add(tag.found.tag_id)
        if tag.pose is not None:
            angle = int(path.stem.rpartition("_")[2])
            poses[angle] = tag.pose.pose
            exact[angle] = rotation_pose(pixels, tag.found, ROTATION_CAMERA)
    if len(poses) < 2:
        return {"images": len(poses)}
    poses, exact = dict(sorted(poses.items())), dict(sorted(exact.items()))
    return {
        "images": len(poses),
        "tags": sorted(tags),
        **_steps(poses),
        "exact_camera": _steps(exact),
    }


def rotation_pose(pixels: npt.NDArray[np.uint8], found: Detection, camera: Intrinsics) -> Pose:
    """Pose of a tag of the rotation series with an exact camera: of both candidates the better fit."""
    target = single(ROTATION_TAG_M, found.tag_id)
    projection = Projection(camera)
    poses = TargetFitter(target, projection).cold(pixels, solve([(target.tags[0], found)], projection))
    return min(poses, key=lambda pose: pose.loss)


def _steps(poses: dict[int, Pose]) -> dict[str, Any]:
    """Figures of a series of poses by nominal angle [deg], rising."""
    steps = [
        np.asarray(cv2.Rodrigues(later.rotation @ earlier.rotation.T)[0]).ravel()
        for earlier, later in itertools.pairwise(poses.values())
    ]
    mean_axis = np.sum(steps, axis=0)
    mean_axis /= np.linalg.norm(mean_axis)
    turned = np.degrees([float(step @ mean_axis) for step in steps])
    errors = np.abs(turned) - np.diff(list(poses))
    return {
        "steps_deg": [round(float(value), 2) for value in turned],
        "step_error_sd_deg": round(float(np.std(errors)), 3),
        "largest_step_error_deg": round(float(np.abs(errors).max()), 3),
        "one_sense": bool((turned > 0).all() or (turned < 0).all()),
        "axis_cam": [round(float(value), 3) for value in mean_axis],
        "residual_px": [round(pose.rms_px, 3) for pose in poses.values()],
    }
