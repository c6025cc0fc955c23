"""Exposure and gain by what the tags need: the rule, the driver, and a camera from dusk to night."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from mkdaemon.config.camera import CameraSection
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.exposure import (
    EXPOSURE,
    ExposureControl,
    Levels,
    Reach,
    Setting,
    levels_of,
    next_setting,
)
from mkdaemon.vision.camera.image import CameraImage, ImageSource, NewestSlot, Shot
from mkdaemon.vision.pipeline import exposure_of, outlines_of
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.targetfile import load
from mkdaemon.vision.track.follower import TargetPose
from mkdaemon.vision.track.tracker import VisionResult
from mksim.scene.electrons import PhotonSensor
from mksim.scene.light import LightConditions
from tests.places import CONFIGS

REACH = Reach(100e-6, 15e-3, 16.0)
WELL = Levels(10.0, EXPOSURE.white, (EXPOSURE.white - 10.0) / EXPOSURE.contrast)


@pytest.mark.parametrize(
    ("now", "seen", "wanted"),
    [
        pytest.param(Setting(4e-3, 2.0), WELL, Setting(4e-3, 2.0), id="good stays"),
        pytest.param(Setting(4e-3, 2.0), Levels(10, 150, 1.0), Setting(2e-3, 4.0), id="clean: shorter, more gain"),
        pytest.param(Setting(4e-3, 8.0), Levels(10, 150, 20.0), Setting(8e-3, 4.0), id="noisy: longer, less gain"),
        pytest.param(Setting(15e-3, 16.0), Levels(2, 20, 6.0), Setting(15e-3, 16.0), id="night: all there is"),
        pytest.param(Setting(4e-3, 1.0), Levels(200, 255, 0.5), Setting(2e-3, 1.0), id="saturated: half"),
        pytest.param(Setting(100e-6, 1.0), Levels(90, 255, 0.5), Setting(100e-6, 1.0), id="sun: as short as it goes"),
        pytest.param(Setting(8e-3, 16.0), Levels(5, 75, 2.0), Setting(8e-3, 16.0), id="greatest gain: not shorter"),
    ],
)
def test_the_next_setting(now: Setting, seen: Levels, wanted: Setting) -> None:
    found = next_setting(now, seen, REACH)
    assert (found.exposure, found.gain) == pytest.approx((wanted.exposure, wanted.gain), rel=0.15)


def test_every_setting_is_within_reach_and_near_the_last_one() -> None:
    rng = np.random.default_rng(0)
    for _ in range(400):
        now = Setting(float(rng.uniform(100e-6, 15e-3)), float(rng.uniform(1, 16)))
        black, white = np.sort(rng.uniform(0, 255, 2))
        found = next_setting(now, Levels(float(black), float(white), float(rng.uniform(0.5, 60))), REACH)
        assert REACH.shortest <= found.exposure <= REACH.longest
        assert 1.0 <= found.gain <= REACH.greatest_gain
        assert found.gain / now.gain <= EXPOSURE.step + 1e-9


def board(grey: float, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Cells of 8 px, black a tenth of white, in the middle of a dark ground."""
    image = np.full((120, 160), 0.3 * grey)
    cells = np.kron(rng.integers(0, 2, (8, 8)), np.ones((8, 8)))
    cells[:8], cells[-8:] = 0, 1
    image[20:84, 40:104] = grey * (0.1 + 0.9 * cells)
    return np.clip(image + noise * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)


CORNERS = np.array([[40.0, 20], [103, 20], [103, 83], [40, 83]])


@pytest.mark.parametrize("noise", [2.0, 10.0])
def test_levels_are_those_of_the_tag(noise: float) -> None:
    seen = levels_of(board(180.0, noise, np.random.default_rng(1)), [CORNERS])
    assert (seen.black, seen.white) == pytest.approx((18, 180), abs=2.5 * noise)
    assert seen.noise == pytest.approx(noise, rel=0.3)


def test_without_a_tag_the_whole_image_speaks() -> None:
    image = board(180.0, 2.0, np.random.default_rng(1))
    assert levels_of(image).white == pytest.approx(180, abs=8)
    outside = CORNERS + 1000.0
    assert levels_of(image, [outside]) == levels_of(image)


def expose(sensor: PhotonSensor, lux: float, setting: Setting, rng: np.random.Generator) -> np.ndarray:
    light = sensor.conditions(LightConditions(), lux, setting.exposure, setting.gain)
    clean = board(235 * 0.85 * light.exposure, 0.0, rng) if light.exposure < 1.2 else np.full((120, 160), 255.0)
    noise = np.sqrt(light.noise_sd**2 + light.shot_gain * clean)
    return np.clip(clean + noise * rng.standard_normal(clean.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("lux", "shorter_than", "contrast"),
    [(50_000.0, 0.2e-3, 20.0), (400.0, 4e-3, 16.0), (20.0, 15.1e-3, 12.0), (2.0, 15.1e-3, 3.0)],
    ids=["sun", "office", "dusk", "night"],
)
def test_from_the_sun_to_the_night_exposure_settles_short_and_readable(
    lux: float, shorter_than: float, contrast: float
) -> None:
    sensor, rng = PhotonSensor(), np.random.default_rng(3)
    control = ExposureControl(REACH)
    for _ in range(12 * EXPOSURE.images):
        control.image_seen(expose(sensor, lux, control.setting, rng), [CORNERS])
    assert control.setting.exposure <= shorter_than
    assert control.levels.contrast >= contrast
    settled = control.setting
    for _ in range(4 * EXPOSURE.images):
        control.image_seen(expose(sensor, lux, control.setting, rng), [CORNERS])
    assert control.setting.exposure == pytest.approx(settled.exposure, rel=0.35)


class Told(ImageSource):
    """A camera that gives images and remembers what it was told."""

    reach = REACH

    def __init__(self) -> None:
        self.controls = self
        self.told: list[Setting] = []
        self.was_told = threading.Event()

    def open(self) -> tuple[str, ...]:
        return ()

    def read(self, timeout: float) -> Shot | None:
        self.was_told.wait(0.001)
        return Shot(np.zeros((8, 8), np.uint8), time.monotonic())

    def adjust(self, setting: Setting) -> tuple[str, ...]:
        self.told.append(setting)
        self.was_told.set()
        return ()

    def close(self) -> None:
        pass


def test_the_thread_of_the_camera_tells_it() -> None:
    camera = Told()
    stream = CameraStream(CameraSection(source="/dev/video0"), camera, NewestSlot[CameraImage]())
    stream.start()
    assert camera.was_told.wait(20.0)
    control = stream.status().control
    camera.was_told.clear()
    control.setting = Setting(4e-3, 2.0)
    assert camera.was_told.wait(20.0)
    stream.stop()
    assert camera.told == [ExposureControl(REACH).setting, Setting(4e-3, 2.0)]


def test_what_a_camera_is_told_is_in_its_stats() -> None:
    control = ExposureControl(REACH)
    assert exposure_of(control).white is None
    for _ in range(EXPOSURE.images):
        control.image_seen(board(180.0, 2.0, np.random.default_rng(1)), [CORNERS])
    told = exposure_of(control)
    assert told.exposure_ms == pytest.approx(1000 * control.setting.exposure)
    assert told.white == pytest.approx(180, abs=8)


def test_tags_are_outlined_where_a_pose_puts_them() -> None:
    tagmap = load([CONFIGS / "targets" / "nested.toml"])
    camera = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
    pose = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 2.0]), np.eye(6), "edges", 100, 0.1)
    found = TargetPose("pad", "pad", pose, np.inf, "attitude", "predicted", 0.0)
    result = VisionResult("down", 1, 0.0, (), (found,), ())
    outer, inner = outlines_of(result, tagmap, Projection(camera))
    assert np.ptp(outer, axis=0) == pytest.approx([600 * 0.3048 / 2] * 2)
    assert np.ptp(inner, axis=0).max() < 20
    assert outlines_of(result, tagmap, None) == []
