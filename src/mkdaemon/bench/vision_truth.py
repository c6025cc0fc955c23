"""What must never happen, and whether the covariance is honest: flights, false positives, flips, NEES, photographs."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.bench.vision_flight import GROUNDS, VGA, fly
from mkdaemon.bench.vision_stills import SeedSet, Studio, error_of, is_flip, look_once, target_named
from mkdaemon.config.vision import TrackerSection
from mkdaemon.sim.scene import Scene
from mkdaemon.sim.scene_light import Conditions
from mkdaemon.sim.scene_view import CameraView
from mkdaemon.vision.attitude import LOOKING_DOWN
from mkdaemon.vision.detection import Detection
from mkdaemon.vision.detector import Detector
from mkdaemon.vision.fitting import TargetFitter
from mkdaemon.vision.intrinsics import Intrinsics
from mkdaemon.vision.pose import FLOOR_ANGLE, FLOOR_LATERAL, FLOOR_RANGE, Pose
from mkdaemon.vision.projection import Projection
from mkdaemon.vision.still import StillEye
from mkdaemon.vision.tagmap import TagMap, single
from mkdaemon.vision.tracker import Tracker

Array = npt.NDArray[np.float64]

PHOTOGRAPHS: Final = Path(__file__).resolve().parents[4] / "shared" / "images"
"""Photographs of real tags beside the checkout; they have their own licences and stay there."""
ROTATION_CAMERA: Final = Intrinsics(width=1056, height=792, fx=329.873, fy=332.946, cx=528.0, cy=396.0)
"""Of the rotation series, as published with it."""
ROTATION_TAG_M: Final = 0.065


def flights(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Twelve random flights of 8 s at 30 fps with every trouble: share posed, wrong poses, flips."""
    count = 2 if quick else 12
    out: dict[str, Any] = {"flights": count, "seconds": 8, "fps": 30, "range_m": [0.35, 4.5]}
    for name in ("nested", "single"):
        target = target_named(name)
        tallies = {True: _Tally(), False: _Tally()}
        for seed in range(count):
            trackers = {key: Tracker(TagMap((target,)), VGA, LOOKING_DOWN) for key in tallies}
            for frame in fly(target, seeds.base + seed):
                for with_attitude, tracker in trackers.items():
                    result = tracker.update(frame.image, frame.attitude if with_attitude else None)
                    found = result.pose_of(target.name)
                    tallies[with_attitude].add(
                        found.pose if found is not None else None, frame.rotation, frame.position, frame.trouble
                    )
        out[name] = {
            "with_attitude": tallies[True].summary(),
            "without_attitude": tallies[False].summary(),
        }
    return out


class _Tally:
    """Counts of one campaign."""

    def __init__(self) -> None:
        self._frames: Counter[str] = Counter()
        self._posed: Counter[str] = Counter()
        self._wrong = self._flips = 0
        self._distance: list[float] = []
        self._angle: list[float] = []

    def add(self, pose: Pose | None, rotation: Array, position: Array, trouble: str) -> None:
        """Compare one frame's pose with the truth."""
        self._frames[trouble or "none"] += 1
        if pose is None:
            return
        self._posed[trouble or "none"] += 1
        error = error_of(pose.rotation, pose.position, rotation, position)
        self._distance.append(error.distance)
        self._angle.append(error.angle_deg)
        self._wrong += error.is_wrong
        self._flips += is_flip(pose.rotation, pose.position, rotation)

    def summary(self) -> dict[str, Any]:
        """The figures."""
        frames, posed = self._frames.total(), self._posed.total()
        return {
            "frames": frames,
            "posed": round(posed / max(frames, 1), 4),
            "wrong": self._wrong,
            "flips": self._flips,
            "median_cm": round(float(np.median(self._distance)) * 100, 4) if posed else None,
            "p99_cm": round(float(np.percentile(self._distance, 99)) * 100, 3) if posed else None,
            "median_deg": round(float(np.median(self._angle)), 4) if posed else None,
            "p99_deg": round(float(np.percentile(self._angle, 99)), 3) if posed else None,
            "posed_by_trouble": {k: round(self._posed[k] / n, 3) for k, n in sorted(self._frames.items())},
        }


def flips(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Single images of the single tag, 1 to 12 m, without attitude: mirrored poses published."""
    count = 150 if quick else 4000
    target = target_named("single")
    studio = Studio(target, seeds.base + 500, fine=False)
    tally = _Tally()
    for _ in range(count):
        rng = studio.rng
        still = studio.shoot(float(rng.uniform(1.0, 12.0)), float(rng.uniform(0, 1.0)))
        found = look_once(still, target, VGA, with_attitude=False).pose_of(target.name)
        tally.add(found.pose if found is not None else None, still.rotation, still.position, "")
    return {"range_m": [1, 12], "tilt_deg": [0, 57], **tally.summary()}


def false_positives(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Tag-free images, every search of the ladder, eight ids allowed."""
    count = 200 if quick else 10_000
    detector = Detector({"tag36h11": frozenset({0, 1, 46, 48, 100, 200, 373, 487})})
    rng = np.random.default_rng([seeds.base, 0xFA15E])
    scenes = [Scene([], ground=kind, seed=seeds.base + 600, fine=False) for kind in GROUNDS]
    found = 0
    for k in range(count):
        height = float(rng.uniform(0.5, 12.0))
        tilt = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3) + np.array([0, 0, float(rng.uniform(0, 6.28))]))[0]
        position = np.array([*rng.uniform(-4, 4, 2), height])
        view = CameraView(VGA, np.asarray(tilt) @ LOOKING_DOWN.flu_from_cam, position)
        noise = float(rng.choice([1.5, 4.0, 15.0]))
        pixels = scenes[k % 4].render(view, Conditions(noise_sd=noise, exposure=float(rng.uniform(0.3, 1.4))))
        found += sum(len(detector.search(pixels, stage)) for stage in detector.stages)
    return {"images": count, "whitelist": 8, "false_positives": found}


def consistency(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """NEES per degree of freedom: of the measurement with an exact lens, of the published one with a drawn lens."""
    count = 30 if quick else 200
    out: dict[str, Any] = {"images_each": count}
    for name, perturbed in (("measurement", False), ("published", True)):
        for target_name in ("single", "nested"):
            target = target_named(target_name)
            studio = Studio(target, seeds.base + 700)
            values, position_only = [], []
            for _ in range(count):
                rng = studio.rng
                lens = _drawn_lens(rng) if perturbed else None
                still = studio.shoot(float(rng.uniform(0.6, 8.0)), float(rng.uniform(0, 0.9)), lens=lens)
                found = look_once(still, target, VGA, with_attitude=False).pose_of(target.name)
                if found is None:
                    continue
                error = error_of(found.pose.rotation, found.pose.position, still.rotation, still.position)
                vector = np.array([*error.xyz, *error.rpy])
                covariance = found.covariance if perturbed else found.pose.covariance
                values.append(float(vector @ np.linalg.solve(covariance, vector)) / 6)
                position_only.append(float(vector[:3] @ np.linalg.solve(covariance[:3, :3], vector[:3])) / 3)
            out[f"{name}_{target_name}"] = {
                "posed": len(values) / count,
                "nees_per_dof": round(float(np.mean(values)), 3) if values else None,
                "median": round(float(np.median(values)), 3) if values else None,
                "position_nees_per_dof": round(float(np.mean(position_only)), 3) if values else None,
            }
    return out


def _drawn_lens(rng: np.random.Generator) -> Intrinsics:
    """A lens that differs from its calibration as the floor allows: focal length .3 %, centre .2 % of the range."""
    scale = 1.0 + FLOOR_RANGE * float(rng.standard_normal())
    shift = FLOOR_LATERAL * VGA.fx * rng.standard_normal(2)
    return VGA.model_copy(
        update={
            "fx": VGA.fx * scale,
            "fy": VGA.fy * scale,
            "cx": VGA.cx + float(shift[0]),
            "cy": VGA.cy + float(shift[1]),
            "k1": float(FLOOR_ANGLE * rng.standard_normal()),
        }
    )


def photographs(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Field photographs with labelled tags, and the rotation series; neither is drawn from a seed."""
    if not PHOTOGRAPHS.is_dir():
        return {"skipped": "the photographs are not beside this checkout"}
    return {"labelled": labelled_tags(PHOTOGRAPHS / "apriltag"), "rotation": rotation_series(PHOTOGRAPHS / "rotation")}


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
        "p95_corner_px": round(float(np.percentile(distances, 95)), 3) if distances else None,
    }


def rotation_series(folder: Path) -> dict[str, Any]:
    """Deviation of measured steps of nominally 20 degrees, each image measured alone with the published camera.

    The images leave residuals of half a pixel with that camera, which vanish with another ratio of the focal lengths:
    stills weigh such a residual against what a calibration knows of the ratio. `exact_camera` holds the figures of fits
    that take the published camera as exact.
    """
    eye = StillEye(ROTATION_CAMERA, tag_size=ROTATION_TAG_M)
    tags: set[int] = set()
    poses: dict[int, Pose] = {}
    exact: dict[int, Pose] = {}
    for path in sorted(folder.glob("test_image_rotation_*.png")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            continue
        pixels = np.asarray(image, dtype=np.uint8)
        seen = [tag for tag in eye.look(pixels).tags if tag.pose is not None]
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
        "fx_over_published": [round(float(np.exp(pose.stretch or 0.0)), 4) for pose in poses.values()],
        "exact_camera": _steps(exact),
    }


def rotation_pose(pixels: npt.NDArray[np.uint8], found: Detection, camera: Intrinsics) -> Pose:
    """Pose of a tag of the rotation series with an exact camera: of both candidates the better fit."""
    target = single(ROTATION_TAG_M, found.tag_id)
    poses = TargetFitter(target, Projection(camera), TrackerSection()).cold(pixels, [(target.tags[0], found)])
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
