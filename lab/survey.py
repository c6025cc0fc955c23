"""Surveys of rooms of 24 tags: how far each tag of the map is off, what its deviations are worth, who is named.

A camera is carried over 6 m x 4 m of floor for a minute, three images a second, rendered with noise and blur. Maps are
judged apart from where they lie as a whole: truth is laid over them by the best motion.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from lab.campaign import Campaign, Ending, First, Jobs, Kept, Row, summed_up
from lab.tables import show
from lab.vision.flight import VGA
from mkdaemon.cli.arguments import AsJson
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.survey.survey import KnownTags, Survey, TagFault, look_at, survey
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Tag, Target
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView

SIDE: Final = 0.16
COLUMNS, ROWS = 6, 4
MOVED: Final = 9
"""Which tag is moved, has another size, or exists twice: one in the middle, which is seen before and after."""
GOAL: Final = 0.005
"""Error of each tag [m], and a thousandth of its distance from the middle more."""
DOWN: Final = np.diag([1.0, -1.0, -1.0])


def room_of(seed: int) -> Target:
    """Tags a metre apart, by hand: a few centimetres and any turn off; every fifth on a step or leaning."""
    rng = np.random.default_rng(seed)
    family, tags = find_family("tag36h11"), []
    for code in range(COLUMNS * ROWS):
        height, lean = (rng.uniform(0.05, 0.3), rng.uniform(0.1, 0.4)) if code % 5 == 4 else (0.0, 0.0)
        place = np.array([code % COLUMNS + rng.normal(0, 0.05), code // COLUMNS + rng.normal(0, 0.05), height])
        tags.append(Tag(family, code, SIDE, place, rotation_from_euler(lean, 0.0, rng.uniform(-np.pi, np.pi))))
    return Target("room", "room", moving=False, level=True, tags=tuple(tags))


def _changed(target: Target, fault: str | None, rng: np.random.Generator) -> Target:
    """The room later, or as it is and was not said to be."""
    tags = list(target.tags)
    one = tags[MOVED]
    if fault == TagFault.MOVED:
        far, way = rng.uniform(0.03, 0.25), rng.uniform(-np.pi, np.pi)
        tags[MOVED] = replace(one, position=one.position + far * np.array([np.cos(way), np.sin(way), 0.0]))
    elif fault == TagFault.WRONG_SIDE:
        tags[MOVED] = replace(one, size=SIDE * rng.choice([0.8, 0.95, 1.04, 1.25]))
    return replace(target, tags=tuple(tags))


def path_of(seed: int, count: int) -> Iterator[CameraView]:
    """Views of a camera that is carried over the room and back, about 2.2 m above the floor."""
    rng = np.random.default_rng(seed + 10_000)
    phases, along = rng.uniform(0, 2 * np.pi, 4), np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    for t in along.tolist():
        # Up and down while it goes across twice and back.
        middle = ((COLUMNS - 1) / 2, (ROWS - 1) / 2)
        x = middle[0] + 2.6 * np.cos(2 * t + phases[0])
        y = middle[1] + 1.6 * np.sin(9 * t + phases[1])
        z = 2.2 + 0.25 * np.sin(3 * t + phases[2])
        lean = rng.normal(0, 0.1, 2)
        turned = rotation_from_euler(lean[0], lean[1], 2 * t + phases[3]) @ DOWN
        speed = rng.normal(0, 0.15, 3)
        yield CameraView(VGA, turned, np.array([x, y, z]), velocity_enu=speed, exposure_time=0.004)


def images_of(room: Row) -> Iterator[Grey]:
    """The images of a survey."""
    rng = np.random.default_rng(room["seed"] + 20_000)
    before = room_of(room["seed"])
    after = _changed(before, room["fault"], rng)
    from_image = rng.uniform(0.3, 0.7) * room["images"] if room["fault"] == TagFault.MOVED else 0
    shown = [[before], [after]]
    if room["fault"] == TagFault.TWICE:  # a target of its own: one shows a code once
        copy = replace(before.tags[MOVED], position=before.tags[0].position + np.array([0.45, 0.5, 0.0]))
        shown[1].append(replace(before, name="copy", tags=(copy,)))
    scenes = [
        Scene([SceneTarget.of(each, Platform()) for each in targets], ground="asphalt", seed=room["seed"], fine=False)
        for targets in shown
    ]
    for number, view in enumerate(path_of(room["seed"], room["images"])):
        yield scenes[number >= from_image].render(view)


def errors_of(found: Survey, truth: Target) -> tuple[Array, Array]:
    """Errors of tags `(n, 3)` [m; map], and their squares over the variances `(n,)`, the map laid over the truth."""
    places = {tag.tag_id: tag.position for tag in truth.tags}
    mapped = np.array([one.tag.position for one in found.tags])
    true = np.array([places[one.tag.tag_id] for one in found.tags])
    off = laid_over(mapped, true)
    return off, (off**2 / np.array([one.place_sd for one in found.tags]) ** 2).sum(axis=1)


def laid_over(mapped: Array, true: Array) -> Array:
    """Errors of places `(n, 3)` [m; map] after true ones `(n, 3)` were laid over them by the best motion.

    Source: W. Kabsch, Acta Crystallographica A 32, 1976.
    """
    a, b = mapped - mapped.mean(axis=0), true - true.mean(axis=0)
    left, _, right = np.linalg.svd(a.T @ b)
    return np.asarray(a - b @ (left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right).T)


def run(room: Row) -> Row:
    """Carry out one survey.

    Args:
        room: `seed`, of places, path and noise; `fault`, what is wrong with one tag, None for nothing; `images`.
    """
    began = time.process_time()
    tags = list(look_at(images_of(room), VGA, "tag36h11", 1))
    looked = time.process_time()
    found = survey(tags, KnownTags(SIDE, {}), Projection(VGA))
    off, squares = errors_of(found, room_of(room["seed"]))
    sizes = np.linalg.norm(off, axis=1)
    places = np.array([one.tag.position for one in found.tags])
    reach = np.linalg.norm(places - places.mean(axis=0), axis=1)
    named = {one.tag_id: str(one.fault) for one in found.left_out}
    expected = {MOVED: room["fault"]} if room["fault"] is not None else {}
    is_near = bool((sizes <= GOAL + 0.001 * reach).all())
    is_good = is_near and named == expected
    return {
        "ending": Ending.FINISHED if is_good else Ending.WRONG,
        "why": "" if is_good else f"worst {1000 * sizes.max():.1f} mm, named {named}",
        "tags": len(found.tags),
        "worst_mm": 1000 * float(sizes.max()),
        "rms_mm": 1000 * float(np.sqrt((sizes**2).mean())),
        "nees": float(squares.mean() / 3.0),
        "rms_px": found.rms_px,
        "looking_s": looked - began,
        "adjusting_s": time.process_time() - looked,
    }


SURVEYS: Final = Campaign("survey", run, dict, limit=900.0)


def main(
    *,
    seeds: int = 20,
    first: First = 1,
    fault: str | None = None,
    images: int = 180,
    jobs: Jobs = 2,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Survey rooms of 24 tags; half a minute of processor time each.

    Args:
        seeds: rooms.
        fault: what is wrong with one tag: moved, twice or wrong_side; nothing where none is given.
        images: of each survey.
    """
    asked = [{"seed": seed, "fault": fault, "images": images} for seed in range(first, first + seeds)]
    rows = SURVEYS.rows(asked, jobs, results)
    figures = summed_up(rows, "worst_mm", "rms_mm", "nees", "rms_px", "looking_s", "adjusting_s")
    return show([figures], ("flights",), as_json=as_json)
