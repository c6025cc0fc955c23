"""Descents from 4 m to 1 m over the nested target with one thing wrong, or nothing: which alarms come, and how soon."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from lab.vision.flight import GROUNDS, IDEAL, LEVEL, LOOKING_DOWN, VGA, Device
from lab.vision.parts import Case, Part
from lab.vision.real import DEVICES
from lab.vision.stills import SeedSet, target_named
from mkdaemon.config.camera import MountSection
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.camera.calibration_file import Camera, mount_rotation
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.selfcal.selfcheck import SelfCheck
from mkdaemon.vision.tags.tagmap import TagMap, Target
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample, Mounting
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView

Array = npt.NDArray[np.float64]

SECONDS, FPS = 10.0, 15.0
HIGH, LOW = 4.0, 1.0
BIAS, WANDER, NOISE = radians(0.3), radians(0.4), radians(0.1)
"""Of the reported attitude: constant, with a correlation of 1 s, and of each sample."""
BAROMETER: Final = 0.15
"""Wander of the barometer, deviation [m], correlation 10 s."""
BAROMETER_DELAY: Final = 0.1
ATTITUDE_SD: Final = radians(1.0)
"""The daemon's setting, `TrackerSection.attitude_sd_deg`."""


class Descent:
    """A way from 4 m to 1 m with wander and yaw to 60 degrees on both sides, seen by attitude and barometer."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 0x5E1F])
        self._phase, self._rates = rng.uniform(0, 2 * np.pi, 5), rng.uniform(1.0, 3.0, 5)
        bias = BIAS * rng.standard_normal(2)
        times = np.arange(0.0, SECONDS + 0.1, 0.02)
        wander = _correlated(rng, len(times), 0.02, 1.0, WANDER, 2)
        noise = NOISE * rng.standard_normal((len(times), 2))
        self.attitude = AttitudeHistory(
            _sample(float(time), self.angles(float(time)) + np.append(bias + slow + fast, 0.0))
            for time, slow, fast in zip(times, wander, noise, strict=True)
        )
        barometer = _correlated(rng, int(SECONDS / 0.2), 0.2, 10.0, BAROMETER, 1)[:, 0]
        self.readings = [
            (0.2 * k, float(np.round((self.height(0.2 * k - BAROMETER_DELAY) + off) / 0.05) * 0.05))
            for k, off in enumerate(barometer)
        ]

    def height(self, time: float) -> float:
        """Of the lens [m]."""
        return float(HIGH + (LOW - HIGH) * np.clip((time - 1.0) / (SECONDS - 2.0), 0.0, 1.0))

    def angles(self, time: float) -> Array:
        """Roll, pitch, yaw [rad]."""
        wave = np.sin(self._rates * time + self._phase)
        yaw = radians(60.0) * np.sin(0.6 * time + self._phase[2])
        return np.array([radians(4.0) * wave[0], radians(4.0) * wave[1], yaw])

    def view(self, time: float) -> CameraView:
        """What the camera sees, hanging exactly below the vehicle."""
        enu_from_cam = rotation_from_euler(*self.angles(time)) @ LOOKING_DOWN.flu_from_cam
        wave = np.sin(0.7 * self._rates * time + self._phase)
        at = np.array([0.25 * wave[3], 0.25 * wave[4], self.height(time)])
        return CameraView(VGA, enu_from_cam, at, np.zeros(3), np.zeros(3), 0.004, time)


def _sample(time: float, angles: Array) -> AttitudeSample:
    roll, pitch, yaw = (float(angle) for angle in angles)
    return AttitudeSample(time, roll, pitch, yaw)


def _correlated(rng: np.random.Generator, count: int, step: float, time: float, sd: float, axes: int) -> Array:
    """Ornstein-Uhlenbeck noise `(count, axes)`."""
    keep = np.exp(-step / time)
    found = sd * rng.standard_normal((count, axes))
    for k in range(1, count):
        found[k] = keep * found[k - 1] + np.sqrt(1 - keep**2) * found[k]
    return found


@dataclass(frozen=True, slots=True)
class Mistake:
    """What the daemon believes wrongly.

    Attributes:
        focal: share by which the focal length in the camera file is too large.
        centre: principal point in the camera file, too far right [px].
        inner: share by which the inner tag is larger in the target file than on the paper.
        mounting: turn of the camera about body forward and left that the file does not know [rad].
        device: the camera.
    """

    focal: float = 0.0
    centre: float = 0.0
    inner: float = 0.0
    mounting: tuple[float, float] = (0.0, 0.0)
    device: Device = IDEAL


MISTAKES: Final = {
    "none": Mistake(),
    "none_webcam": Mistake(device=DEVICES["webcam"]),
    "focal_2_percent": Mistake(focal=0.02),
    "centre_10_px": Mistake(centre=10.0),
    "inner_size_2_percent": Mistake(inner=0.02),
    "mounting_3_deg": Mistake(mounting=(radians(2.0), radians(-2.236))),
}
"""By name."""
FLIGHTS: Final = {"none": 40, "none_webcam": 12}
"""Of a mistake; eight of the others."""


def _believed(mistake: Mistake) -> tuple[Camera, Target]:
    """Camera file and target file with the mistake in them."""
    lens = VGA.model_copy(
        update={"fx": VGA.fx * (1 + mistake.focal), "fy": VGA.fy * (1 + mistake.focal), "cx": VGA.cx + mistake.centre}
    )
    roll, pitch = np.degrees(mistake.mounting)
    camera = Camera(intrinsics=lens, mount=MountSection(rpy_deg=(-float(roll), -float(pitch), 0.0)))
    target = target_named("nested")
    outer, inner = target.tags
    return camera, replace(target, tags=(outer, replace(inner, size=inner.size * (1 + mistake.inner))))


def _images(descent: Descent, seed: int, device: Device) -> Iterator[CameraImage]:
    scene = Scene([SceneTarget.of(target_named("nested"), LEVEL)], ground=GROUNDS[seed % 4], seed=seed, fine=False)
    for k in range(int(SECONDS * FPS)):
        time = (k + 0.5) / FPS
        yield CameraImage(scene.render(descent.view(time), device.conditions), time, time, k, "bench", "driver")


def descend(name: str, seed: int) -> dict[str, float]:
    """Fly one descent with a mistake; returns the time of the first alarm of each kind [s]."""
    mistake = MISTAKES[name]
    camera, target = _believed(mistake)
    descent = Descent(seed)
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
    return alarms


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    return [
        Part(descend, (name, seeds.base + 1500 + k), int(SECONDS * FPS))
        for name in MISTAKES
        for k in range(2 if quick else FLIGHTS.get(name, 8))
    ]


def _sum_up(_quick: bool, parts: Sequence[Part], found: Sequence[dict[str, float]]) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for name in MISTAKES:
        alarms = [one for part, one in zip(parts, found, strict=True) if part.args[0] == name]
        counts = Counter(alarm for one in alarms for alarm in one)
        after = {alarm: float(np.median([one[alarm] for one in alarms if alarm in one])) for alarm in counts}
        rows[name] = {"descents": len(alarms), "alarms": dict(counts), "after_s": after}
    return rows


SELFCAL: Final = Case(_plan, _sum_up)
"""Alarms of the self-calibration, and the median time until they come."""
