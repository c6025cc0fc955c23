"""Stills: cold detection, accuracy, view angle, and what light and things lying about do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mkdaemon.bench.vision_flight import VGA, band, patches, shadow
from mkdaemon.bench.vision_stills import HD, SeedSet, Studio, error_of, look_once, target_named
from mkdaemon.sim.scene_light import Conditions, Glare
from mkdaemon.vision.detector import Detector
from mkdaemon.vision.tagmap import TagMap

FOOT = 0.3048
COLD_DISTANCES = (0.10, 0.15, 0.2, 0.3, 0.5, 0.75, 1.0, 2.0, 3.0, 4.57, 6.0, 8.0, 9.0, 10.0, 11.0, 12.0)
HD_DISTANCES = (2.0, 8.0, 12.0, 15.0, 18.0)
ERROR_DISTANCES = (0.5, 2 * FOOT, 1.0, 4 * FOOT, 6 * FOOT, 2.5, 3.5, 15 * FOOT, 8.0, 12.0)
ANGLES_DEG = (60, 70, 73, 75, 78, 80, 82, 84)


def cold(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Share of single images in which a target is decoded, and posed, by distance."""
    count = 10 if quick else 40
    out: dict[str, Any] = {"images_each": count}
    for name, intrinsics, distances in (
        ("nested", VGA, COLD_DISTANCES),
        ("single", VGA, COLD_DISTANCES),
        ("single_720p", HD, HD_DISTANCES),
    ):
        target = target_named(name.partition("_")[0])
        studio = Studio(target, seeds.base + 100, intrinsics=intrinsics, fine=False)
        detector = Detector(TagMap((target,)).whitelist)
        rows = []
        for distance in distances:
            decoded = posed = posed_blind = wrong = 0
            for _ in range(count):
                still = studio.shoot(distance, float(studio.rng.uniform(0, 0.7)), off=0.05 if distance < 0.2 else 0.12)
                decoded += bool(detector.climb(still.image.pixels))
                for with_attitude in (True, False):
                    pose = look_once(still, target, intrinsics, with_attitude=with_attitude).pose_of(target.name)
                    if pose is None:
                        continue
                    posed += with_attitude
                    posed_blind += not with_attitude
                    wrong += _is_wrong(pose.pose.rotation, pose.pose.position, still)
            rows.append(
                {
                    "distance": distance,
                    "decoded": decoded / count,
                    "posed": posed / count,
                    "posed_without_attitude": posed_blind / count,
                    "wrong": wrong,
                }
            )
        out[name] = rows
    return out


def _is_wrong(rotation: Any, position: Any, still: Any) -> bool:
    """Far away 5 cm is less than the calibration floor: 1 % of the range counts where that is more."""
    error = error_of(rotation, position, still.rotation, still.position)
    return error.distance > max(0.05, 0.01 * float(np.linalg.norm(still.position))) or error.angle_deg > 5.0


def accuracy(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Mean and deviation of position and angles, by distance: over many views, and over noise alone."""
    count = 12 if quick else 60
    target = target_named("single")
    out: dict[str, Any] = {"images_each": count, "tilt_deg": [0, 40], "camera": "exact calibration"}
    rows = []
    studio = Studio(target, seeds.base + 200)
    for distance in ERROR_DISTANCES:
        errors = []
        for _ in range(count):
            still = studio.shoot(distance, float(studio.rng.uniform(0, 0.7)), off=0.01 if distance < 0.7 else 0.12)
            pose = look_once(still, target, VGA, with_attitude=True).pose_of(target.name)
            if pose is not None:
                errors.append(error_of(pose.pose.rotation, pose.pose.position, still.rotation, still.position))
        xyz = np.array([error.xyz for error in errors]).reshape(-1, 3) * 100
        rpy = np.degrees(np.array([error.rpy for error in errors]).reshape(-1, 3))
        rows.append(
            {
                "distance": distance,
                "posed": len(errors) / count,
                "mean_3d_cm": _round(np.linalg.norm(xyz, axis=1).mean()) if len(errors) else None,
                "max_3d_cm": _round(np.linalg.norm(xyz, axis=1).max()) if len(errors) else None,
                "mean_xyz_cm": _list(xyz.mean(axis=0)) if len(errors) else None,
                "sd_xyz_cm": _list(xyz.std(axis=0)) if len(errors) else None,
                "mean_rpy_deg": _list(rpy.mean(axis=0)) if len(errors) else None,
                "sd_rpy_deg": _list(rpy.std(axis=0)) if len(errors) else None,
                "wrong": sum(error.is_wrong for error in errors),
            }
        )
    out["by_distance"] = rows
    return out


def view_angle(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Share of images posed at steep views from 2 m, the target in the middle and near the edge of the image."""
    count = 12 if quick else 50
    target = target_named("single")
    detector = Detector(TagMap((target,)).whitelist)
    out: dict[str, Any] = {"images_each": count, "distance": 2.0}
    for place, off in (("centre", 0.02), ("edge", 0.30)):
        studio = Studio(target, seeds.base + 300, fine=False)
        rows = []
        for degrees in ANGLES_DEG:
            decoded = posed = wrong = 0
            for _ in range(count):
                still = studio.shoot(2.0, float(np.radians(degrees)), off=off)
                decoded += bool(detector.climb(still.image.pixels))
                pose = look_once(still, target, VGA, with_attitude=True).pose_of(target.name)
                if pose is not None:
                    posed += 1
                    wrong += _is_wrong(pose.pose.rotation, pose.pose.position, still)
            rows.append({"angle_deg": degrees, "decoded": decoded / count, "posed": posed / count, "wrong": wrong})
        out[place] = rows
    return out


def conditions(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Cold start of the nested target under occlusion, light and lens faults, 0.5 to 2 m: one whole tag can be seen."""
    count = 12 if quick else 50
    target = target_named("nested")
    side = target.tags[0].size
    detector = Detector(TagMap((target,)).whitelist)
    base = Conditions()
    draws: dict[str, Callable[[np.random.Generator], Conditions]] = {"none": lambda _: base}
    for percent in (5, 10, 20, 30):
        draws[f"side_cut_{percent}"] = lambda rng, p=percent: replace(base, covers=(band(rng, side, p / 100),))  # type: ignore[misc]
    for percent in (5, 10, 20, 30):
        draws[f"patches_{percent}"] = lambda rng, p=percent: replace(base, covers=patches(rng, side, p / 100))  # type: ignore[misc]
    for ratio in (2, 3, 4, 5):
        draws[f"shadow_{ratio}_to_1"] = lambda rng, r=ratio: replace(base, shadow=shadow(rng, side, r))  # type: ignore[misc]
    draws["gradient_32_to_1"] = lambda rng: replace(base, gradient=32.0, gradient_angle=float(rng.uniform(0, 6.28)))
    for tenths in (1, 2):
        draws[f"glare_0.{tenths}"] = lambda rng, t=tenths: replace(base, glare=(_glare(rng, side, t / 10),))  # type: ignore[misc]
    draws["exposure_6"] = lambda _: replace(base, exposure=0.06)
    draws["noise_sd_40"] = lambda _: replace(base, noise_sd=40.0)
    draws["jpeg_q20"] = lambda _: replace(base, jpeg_quality=20)
    draws["defocus_5px"] = lambda _: replace(base, defocus_px=5.0)
    out: dict[str, Any] = {"images_each": count, "target": "nested", "distance": [0.5, 2.0]}
    rows = []
    for name, draw in draws.items():
        studio = Studio(target, seeds.base + 400, fine=False)
        decoded = posed = blind = wrong = 0
        for _ in range(count):
            rng = studio.rng
            still = studio.shoot(float(rng.uniform(0.5, 2.0)), float(rng.uniform(0, 0.7)), draw(rng), off=0.08)
            decoded += bool(detector.climb(still.image.pixels))
            for with_attitude in (True, False):
                pose = look_once(still, target, VGA, with_attitude=with_attitude).pose_of(target.name)
                if pose is not None:
                    posed += with_attitude
                    blind += not with_attitude
                    wrong += _is_wrong(pose.pose.rotation, pose.pose.position, still)
        rows.append(
            {
                "condition": name,
                "decoded": decoded / count,
                "posed": posed / count,
                "posed_without_attitude": blind / count,
                "wrong": wrong,
            }
        )
    out["by_condition"] = rows
    return out


def _glare(rng: np.random.Generator, side: float, share: float) -> Glare:
    """A highlight with a saturated disc of `share` of the side across; at strength 2 it reaches half the peak."""
    where = rng.uniform(-0.4, 0.4, 2) * side
    return Glare((float(where[0]), float(where[1])), share / 2 * side, 2.0)


def _round(value: Any) -> float:
    return round(float(value), 4)


def _list(values: Any) -> list[float]:
    return [_round(value) for value in values]
