"""Stills: cold detection, accuracy, view angle, and what light and things lying about do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from lab.vision.flight import VGA
from lab.vision.looks import Look, look
from lab.vision.parts import Case, Part
from lab.vision.stills import SeedSet, Still, Studio, error_of, look_once, target_named
from lab.vision.troubles import band, patches, shadow
from mkdaemon.vision.tags.tagmap import Target
from mksim.scene.light import Glare, LightConditions

FOOT = 0.3048
COLD_DISTANCES = (0.10, 0.15, 0.2, 0.3, 0.5, 0.75, 1.0, 2.0, 3.0, 4.57, 6.0, 8.0, 9.0, 10.0, 11.0, 12.0)
ERROR_DISTANCES = (0.5, 2 * FOOT, 1.0, 4 * FOOT, 6 * FOOT, 2.5, 3.5, 15 * FOOT, 8.0, 12.0)
ANGLES_DEG = (60, 70, 73, 75, 78, 80, 82, 84)


PLACES: Final = {"centre": 0.02, "edge": 0.30}
"""How far the target is from the middle of the image, in tangents of the view angle."""


def _plan_cold(quick: bool, seeds: SeedSet) -> list[Part]:
    count = 10 if quick else 40
    return [
        Part(_cold_row, (name, distance, count, seeds.base + 100, part), count)
        for name in ("nested", "single")
        for part, distance in enumerate(COLD_DISTANCES)
    ]


def _cold_row(name: str, distance: float, count: int, seed: int, part: int) -> dict[str, Any]:
    """Share of single images in which a target is posed, at one distance."""
    target = target_named(name)
    studio = Studio(target, seed, fine=False, part=part)
    off = 0.05 if distance < 0.2 else 0.12
    stills = (studio.shoot(distance, float(studio.rng.uniform(0, 0.7)), off=off) for _ in range(count))
    return {"distance": distance, **_shares(target, stills)}


def _sum_up_rows(_quick: bool, parts: Sequence[Part], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    grouped: dict[str, Any] = {"images_each": parts[0].images}
    for part, row in zip(parts, rows, strict=True):
        grouped.setdefault(part.args[0], []).append(row)
    return grouped


def _shares(target: Target, stills: Iterable[Still], *, blind: bool = True) -> dict[str, Any]:
    """How often a target is posed in single images, with attitude and, where asked, without, and how often wrongly."""
    names = {"posed": True, "posed_without_attitude": False} if blind else {"posed": True}
    looks: dict[str, list[Look]] = {name: [] for name in names}
    for still in stills:
        for name, known in names.items():
            looks[name].append(look(still, look_once(still, target, VGA, with_attitude=known).pose_of(target.name)))
    shares = {name: sum(one.posed for one in some) / len(some) for name, some in looks.items()}
    return shares | {"wrong": sum(one.wrong for some in looks.values() for one in some)}


def _plan_accuracy(quick: bool, seeds: SeedSet) -> list[Part]:
    count = 12 if quick else 60
    return [
        Part(_accuracy_row, (distance, count, seeds.base + 200, part), count)
        for part, distance in enumerate(ERROR_DISTANCES)
    ]


def _accuracy_row(distance: float, count: int, seed: int, part: int) -> dict[str, Any]:
    """Mean and deviation of position and angles over many views from one distance."""
    target = target_named("single")
    studio = Studio(target, seed, part=part)
    errors = []
    for _ in range(count):
        still = studio.shoot(distance, float(studio.rng.uniform(0, 0.7)), off=0.01 if distance < 0.7 else 0.12)
        pose = look_once(still, target, VGA, with_attitude=True).pose_of(target.name)
        if pose is not None:
            errors.append(error_of(pose.pose.rotation, pose.pose.position, still.rotation, still.position))
    xyz = np.array([error.xyz for error in errors]).reshape(-1, 3) * 100
    rpy = np.degrees(np.array([error.rpy for error in errors]).reshape(-1, 3))
    return {
        "distance": distance,
        "posed": len(errors) / count,
        "mean_3d_cm": _round(np.linalg.norm(xyz, axis=1).mean()) if errors else None,
        "max_3d_cm": _round(np.linalg.norm(xyz, axis=1).max()) if errors else None,
        "mean_xyz_cm": _list(xyz.mean(axis=0)) if errors else None,
        "sd_xyz_cm": _list(xyz.std(axis=0)) if errors else None,
        "sd_rpy_deg": _list(rpy.std(axis=0)) if errors else None,
        "wrong": sum(error.is_wrong for error in errors),
    }


def _sum_up_accuracy(_quick: bool, parts: Sequence[Part], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {"images_each": parts[0].images, "by_distance": list(rows)}


def _plan_view_angle(quick: bool, seeds: SeedSet) -> list[Part]:
    count = 12 if quick else 50
    return [
        Part(_view_row, (place, degrees, count, seeds.base + 300, 100 * k + part), count)
        for k, place in enumerate(PLACES)
        for part, degrees in enumerate(ANGLES_DEG)
    ]


def _view_row(place: str, degrees: int, count: int, seed: int, part: int) -> dict[str, Any]:
    """Share of images posed at one steep view from 2 m."""
    target = target_named("single")
    studio = Studio(target, seed, fine=False, part=part)
    stills = (studio.shoot(2.0, float(np.radians(degrees)), off=PLACES[place]) for _ in range(count))
    return {"angle_deg": degrees, **_shares(target, stills, blind=False)}


def draws(side: float) -> dict[str, Callable[[np.random.Generator], LightConditions]]:
    """What light, lens and things lying about do, by name."""
    base = LightConditions()
    draws: dict[str, Callable[[np.random.Generator], LightConditions]] = {"none": lambda _: base}
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
    return draws


def _plan_conditions(quick: bool, seeds: SeedSet) -> list[Part]:
    count = 12 if quick else 50
    return [Part(_condition_row, (name, count, seeds.base + 400, part), count) for part, name in enumerate(draws(1.0))]


def _condition_row(name: str, count: int, seed: int, part: int) -> dict[str, Any]:
    """Cold start of the nested target in one kind of bad image, 0.5 to 2 m: one whole tag can be seen."""
    target = target_named("nested")
    draw = draws(target.tags[0].size)[name]
    studio = Studio(target, seed, fine=False, part=part)
    rng = studio.rng
    stills = (
        studio.shoot(float(rng.uniform(0.5, 2.0)), float(rng.uniform(0, 0.7)), draw(rng), off=0.08)
        for _ in range(count)
    )
    return {"condition": name, **_shares(target, stills)}


def _sum_up_conditions(_quick: bool, parts: Sequence[Part], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {"images_each": parts[0].images, "by_condition": list(rows)}


def _glare(rng: np.random.Generator, side: float, share: float) -> Glare:
    """A highlight with a saturated disc of `share` of the side across; at strength 2 it reaches half the peak."""
    where = rng.uniform(-0.4, 0.4, 2) * side
    return Glare((float(where[0]), float(where[1])), share / 2 * side, 2.0)


def _round(value: Any) -> float:
    return round(float(value), 4)


def _list(values: Any) -> list[float]:
    return [_round(value) for value in values]


COLD: Final = Case(_plan_cold, _sum_up_rows)
"""Share of single images in which a target is posed, by distance."""
ACCURACY: Final = Case(_plan_accuracy, _sum_up_accuracy)
"""Mean and deviation of position and angles, by distance."""
VIEW_ANGLE: Final = Case(_plan_view_angle, _sum_up_rows)
"""Share of images posed at steep views, the target in the middle and near the edge of the image."""
CONDITIONS: Final = Case(_plan_conditions, _sum_up_conditions)
"""Cold start under occlusion, light and lens faults."""
