"""Targets that leave the image over every side and corner: nothing may fault there, and nothing wrong be published.

Sequences of four images: the target anywhere in view, then its middle on the way out, at the border, and beyond.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import cycle
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from lab.vision.flight import GROUNDS, LOOKING_DOWN, VGA
from lab.vision.looks import Look, figures, look
from lab.vision.parts import Case, Part, in_parts
from lab.vision.stills import SeedSet, Still, ground_of, look_along, target_named
from mkdaemon.frames import euler_from_rotation
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import CameraView

Array = npt.NDArray[np.float64]

NEAR_M, FAR_M, MOST_TILT = 0.1, 14.0, 1.1
"""Distances are drawn evenly by their logarithm, tilts to 63 degrees."""
WAY_OUT: Final = (0.35, 0.75, 1.0, 1.25)
"""Where the middle of the target is in each image: share of the way from the middle of the image to its border."""
TURNING_SD, EXPOSURE = 0.3, 0.003
"""Of the camera about each axis [rad/s], and how long its shutter is open [s]."""
PAUSE: Final = 2.0
"""Between sequences [s]; a track ends meanwhile."""
ROLLING: Final = VGA.model_copy(update={"line_time": 30e-6})
CAMERAS: Final = {"global": VGA, "rolling": ROLLING}


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    each = 400 if quick else 12_500
    kinds = [(name, camera) for name in ("nested", "single") for camera in CAMERAS]
    return [
        Part(_leave, (name, camera, count, seeds.base + 1300 + k, part), count)
        for part, count in in_parts(each, 100 if quick else 1000)
        for k, (name, camera) in enumerate(kinds)
    ]


def _leave(name: str, camera: str, count: int, seed: int, part: int) -> tuple[list[Look], list[str]]:
    """Looks at a target leaving, every second sequence without an attitude; places of exceptions and wrong poses."""
    target, looks, places = target_named(name), list[Look](), list[str]()
    tracker = Tracker(TagMap((target,)), CAMERAS[camera], LOOKING_DOWN)
    for k, still in enumerate(ways_out(name, camera, count, seed, part)):
        attitude = still.attitude if k // len(WAY_OUT) % 2 == 0 else None
        place = f"{name} {camera} seed {seed} part {part} image {k}"
        try:
            found = tracker.update(still.image, attitude).pose_of(target.name)
        except Exception as fault:  # noqa: BLE001 - what faults is what this campaign counts
            places.append(f"{place}: {fault!r}")
            continue
        looks.append(look(still, found))
        if looks[-1].wrong:
            places.append(f"{place}: {looks[-1].off:.3f} m, {looks[-1].turned:.1f} degrees")
    return looks, places


def ways_out(name: str, camera: str, count: int, seed: int, part: int) -> Iterator[Still]:
    """Images of sequences."""
    rng = np.random.default_rng([seed, 0x1EA7E, part])
    intrinsics, placed = CAMERAS[camera], SceneTarget.of(target_named(name), Platform())
    scenes = cycle(
        [Scene([placed], ground=ground_of(kind, seed), seed=seed + 1000 * part, fine=False) for kind in GROUNDS[:3]]
    )
    half = np.array([intrinsics.width / intrinsics.fx, intrinsics.height / intrinsics.fy]) / 2
    time = 0.0
    for first in range(0, count, len(WAY_OUT)):
        scene = next(scenes)
        distance = float(np.exp(rng.uniform(np.log(NEAR_M), np.log(FAR_M))))
        tilt, around, roll, toward = rng.uniform(0, MOST_TILT), *rng.uniform(0, 2 * np.pi, 3)
        side = np.array([np.cos(around), np.sin(around), 0.0])
        place = distance * (np.sin(tilt) * side + np.cos(tilt) * np.array([0.0, 0.0, 1.0]))
        heading = np.array([np.cos(toward), np.sin(toward)])
        border = heading * float(np.min(half / np.maximum(np.abs(heading), 1e-9)))
        for k, way in enumerate(WAY_OUT[: count - first]):
            time += 1 / 30
            axes = look_along(-place, float(roll), np.arctan(way * border))
            view = CameraView(
                intrinsics,
                axes,
                place,
                rate_cam=TURNING_SD * rng.standard_normal(3),
                exposure_time=EXPOSURE,
                line_time=intrinsics.line_time or 0.0,
            )
            rotation, position = cam_from_target(placed, view)
            noise = np.radians(0.5) * np.array([*rng.standard_normal(2), 0.0])
            rpy = np.array(euler_from_rotation(axes @ LOOKING_DOWN.flu_from_cam.T)) + noise
            sample = AttitudeSample(time, *(float(angle) for angle in rpy))
            image = CameraImage(scene.render(view), time, time, first + k, "bench", "driver")
            yield Still(image, AttitudeHistory([sample]), rotation, position)
        time += PAUSE


def _sum_up(_quick: bool, parts: Sequence[Part], found: Sequence[tuple[list[Look], list[str]]]) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for name, camera in dict.fromkeys(part.args[:2] for part in parts):
        mine = [pair for part, pair in zip(parts, found, strict=True) if part.args[:2] == (name, camera)]
        images = sum(part.images for part in parts if part.args[:2] == (name, camera))
        looks = [one for seen, _ in mine for one in seen]
        places = [one for _, noted in mine for one in noted]
        rows[f"{name}_{camera}"] = figures(looks) | {"faults": images - len(looks), "first_places": places[:10]}
    return rows


LEAVING: Final = Case(_plan, _sum_up)
"""50,000 images of targets that leave the image."""
