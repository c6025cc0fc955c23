"""Descents from 4 m to 1 m over the nested target with one thing wrong, or nothing: which alarms come, and how soon."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from lab.vision.descent import FPS, SECONDS, Descent
from lab.vision.flight import GROUNDS, IDEAL, LEVEL, VGA, Device
from lab.vision.parts import Case, Part
from lab.vision.real import DEVICES
from lab.vision.stills import SeedSet, target_named
from mkdaemon.config.camera import MountSection
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.vision.camera.calibration_file import Camera, mount_rotation
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.selfcal.selfcheck import SelfCheck
from mkdaemon.vision.tags.tagmap import TagMap, Target
from mkdaemon.vision.track.attitude import Mounting
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.scene import Scene, SceneTarget

Array = npt.NDArray[np.float64]

ATTITUDE_SD: Final = radians(1.0)
"""What the daemon is told, `TrackerSection.attitude_sd_deg`."""


@dataclass(frozen=True, slots=True)
class Mistake:
    """What the daemon believes wrongly.

    Attributes:
        focal: share by which the focal length in the camera file is too large.
        centre: principal point in the camera file, too far right [px].
        inner: share by which the inner tag is larger in the target file than on the paper.
        sizes: the same for all tags.
        mounting: turn of the camera about body forward and left that the file does not know [rad].
        yaws: whether the vehicle turns by 60 degrees to both sides.
        device: the camera.
    """

    focal: float = 0.0
    centre: float = 0.0
    inner: float = 0.0
    sizes: float = 0.0
    mounting: tuple[float, float] = (0.0, 0.0)
    yaws: bool = True
    device: Device = IDEAL


MISTAKES: Final = {
    "none": Mistake(),
    "none_no_yaw": Mistake(yaws=False),
    "none_gamma": Mistake(device=DEVICES["gamma"]),
    "none_webcam": Mistake(device=DEVICES["webcam"]),
    "focal_2_percent": Mistake(focal=0.02),
    "centre_10_px": Mistake(centre=10.0),
    "inner_size_2_percent": Mistake(inner=0.02),
    "inner_size_2_percent_webcam": Mistake(inner=0.02, device=DEVICES["webcam"]),
    "all_sizes_2_percent": Mistake(sizes=0.02),
    "all_sizes_20_percent": Mistake(sizes=0.2),
    "mounting_3_deg": Mistake(mounting=(radians(2.0), radians(-2.236))),
    "mounting_3_deg_no_yaw": Mistake(mounting=(radians(2.0), radians(-2.236)), yaws=False),
}
"""By name."""
FLIGHTS: Final = {"none": 40, "none_webcam": 12}
"""Of a mistake; eight of the others."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One descent.

    Attributes:
        alarms: with the time of the first one of each kind [s].
        found: the last estimates; none when the target was never looked at.
        bias_deg: constant error of the reported attitude, which counts as mounting.
    """

    alarms: dict[str, float]
    found: SelfCalibration | None
    bias_deg: tuple[float, float]


def _believed(mistake: Mistake) -> tuple[Camera, Target]:
    """Camera file and target file with the mistake in them."""
    lens = VGA.model_copy(
        update={"fx": VGA.fx * (1 + mistake.focal), "fy": VGA.fy * (1 + mistake.focal), "cx": VGA.cx + mistake.centre}
    )
    roll, pitch = np.degrees(mistake.mounting)
    camera = Camera(intrinsics=lens, mount=MountSection(rpy_deg=(-float(roll), -float(pitch), 0.0)))
    target = target_named("nested")
    outer, inner = target.tags
    grown = 1 + mistake.sizes
    tags = (replace(outer, size=outer.size * grown), replace(inner, size=inner.size * grown * (1 + mistake.inner)))
    return camera, replace(target, tags=tags)


def _images(descent: Descent, seed: int, device: Device) -> Iterator[CameraImage]:
    scene = Scene([SceneTarget.of(target_named("nested"), LEVEL)], ground=GROUNDS[seed % 4], seed=seed, fine=False)
    for k in range(int(SECONDS * FPS)):
        time = (k + 0.5) / FPS
        yield CameraImage(scene.render(descent.view(time), device.conditions), time, time, k, "bench", "driver")


def descend(name: str, seed: int) -> Outcome:
    """Fly one descent with a mistake."""
    mistake = MISTAKES[name]
    camera, target = _believed(mistake)
    descent = Descent(seed, yaws=mistake.yaws)
    mounting = Mounting(mount_rotation(camera.mount), np.zeros(3))
    tagmap = TagMap((target,))
    tracker = Tracker(tagmap, camera.intrinsics, mounting)
    check = SelfCheck(tagmap, camera, ATTITUDE_SD)
    readings, alarms = list(descent.readings), dict[str, float]()
    for image in _images(descent, seed, mistake.device):
        now = image.captured_at
        while readings and readings[0][0] <= now:
            check.barometer_received(*readings.pop(0))
        found = tracker.update(image, descent.attitude).pose_of(target.name)
        if found is not None:
            target_from_cam, lens, _ = found.camera_in_target()
            height = float((lens - target_from_cam @ mounting.flu_from_cam.T @ mounting.position_flu)[2])
            seen = {target.name: (found.pose, height)}
            check.image_seen(image.pixels, seen, now, descent.attitude.at(now, 0.25))
        for alarm in check.alarms:
            alarms.setdefault(alarm.value, now)
    bias = (float(np.degrees(descent.bias[0])), float(np.degrees(descent.bias[1])))
    return Outcome(alarms, next(iter(check.reports()), None), bias)


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    return [
        Part(descend, (name, seeds.base + 1500 + k), int(SECONDS * FPS))
        for name in MISTAKES
        for k in range(2 if quick else FLIGHTS.get(name, 8))
    ]


def _sum_up(_quick: bool, parts: Sequence[Part], found: Sequence[Outcome]) -> dict[str, Any]:
    return {
        name: _row(MISTAKES[name], [one for part, one in zip(parts, found, strict=True) if part.args[0] == name])
        for name in dict.fromkeys(part.args[0] for part in parts)
    }


def _row(mistake: Mistake, flights: Sequence[Outcome]) -> dict[str, Any]:
    """Descents, alarms, and how far estimates were off, in their unit and in their deviations."""
    seen = [one for one in flights if one.found is not None]
    row: dict[str, Any] = {
        "descents": len(flights),
        "looked_at": len(seen),
        "alarms": dict(Counter(alarm for one in flights for alarm in one.alarms)),
        "told_after_s": {
            alarm: round(float(np.median([one.alarms[alarm] for one in flights if alarm in one.alarms])), 1)
            for alarm in sorted({alarm for one in flights for alarm in one.alarms})
        },
    }
    for name, errors in _errors(mistake, seen).items():
        off, sd = np.array(errors).T
        row[name] = {
            "rms": round(float(np.sqrt((off**2).mean())), 3),
            "largest": round(float(np.abs(off).max()), 3),
            "sd": round(float(sd.mean()), 3),
        }
    return row


def _errors(mistake: Mistake, flights: Sequence[Outcome]) -> dict[str, list[tuple[float, float]]]:
    """Error and deviation of every estimate."""
    errors: dict[str, list[tuple[float, float]]] = {}
    inner_id = target_named("nested").tags[1].tag_id
    for one in flights:
        found = one.found
        assert found is not None
        focal, inner = -100 * np.log1p(mistake.focal), -100 * np.log1p(mistake.inner)
        for axis, name in enumerate(("mounting_roll_deg", "mounting_pitch_deg")):
            # A bias of the attitude looks like a camera that is turned the other way.
            off = found.mounting_deg[axis] - float(np.degrees(mistake.mounting[axis])) + one.bias_deg[axis]
            errors.setdefault(name, []).append((off, found.mounting_sd_deg[axis]))
        errors.setdefault("focal_percent", []).append((found.focal_percent - focal, found.focal_sd_percent))
        errors.setdefault("cx_px", []).append((found.centre_px[0] + mistake.centre, found.centre_sd_px[0]))
        errors.setdefault("k1", []).append((found.k1, found.k1_sd))
        tag = next(size for size in found.sizes if size.tag_id == inner_id)
        errors.setdefault("inner_percent", []).append((tag.size_percent - inner, tag.size_sd_percent))
        height = 100 * (1 - 1 / ((1 + mistake.sizes) * (1 + mistake.focal)))
        errors.setdefault("height_percent", []).append((found.height_percent - height, found.height_sd_percent))
    return errors


SELFCAL: Final = Case(_plan, _sum_up)
"""Alarms and errors of the self-calibration."""
