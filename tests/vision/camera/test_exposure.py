"""Exposure and gain by what the tags need: the rule, a camera from dusk to night, and the driver."""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import VisionError
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.exposure import (
    EXPOSURE,
    GREATEST_GAIN,
    Control,
    ExposureControl,
    Levels,
    Reach,
    Setting,
    V4l2Controls,
    levels_of,
    next_setting,
)
from mkdaemon.vision.camera.image import CameraImage, NewestSlot
from mkdaemon.vision.camera.sources import source_of
from mkdaemon.vision.pipeline import outlines_of
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.targetfile import load
from mkdaemon.vision.track.follower import TargetPose
from mkdaemon.vision.track.tracker import VisionResult
from mksim.scene.electrons import PhotonSensor
from mksim.scene.light import LightConditions
from tests.places import CONFIGS
from tests.vision.streams import wait_for_status

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


VIDIOC_QUERYCTRL, VIDIOC_S_CTRL = 0xC0445624, 0xC008561C
"""As gcc computes them from linux/videodev2.h."""
FLAGS_AT = 56
DISABLED, READ_ONLY = 1, 4
WEBCAM = {
    Control.GAIN: "13099800010000004761696e0000000000000000000000000000000000000000000000000000000000000000ff000000"
    "0100000000000000000000000000000000000000",
    Control.EXPOSURE_AUTO: "01099a00030000004175746f204578706f737572650000000000000000000000000000000000000000"
    "000000030000000100000003000000000000000000000000000000",
    Control.EXPOSURE_ABSOLUTE: "02099a00010000004578706f737572652054696d652c204162736f6c7574650000000000000000"
    "0003000000ff07000001000000fa000000100000000000000000000000",
}
"""v4l2_queryctrl of each control: gain 0 to 255, exposure 3 to 2047 and inactive while it is automatic."""
AUTOMATIC_GAIN = {
    Control.AUTOGAIN: "12099800020000004761696e2c204175746f6d617469630000000000000000000000000000000000"
    "00000000010000000100000000000000000000000000000000000000"
}
SETTING = Setting(4e-3, GREATEST_GAIN)


class Kernel:
    """A device's ioctl.

    Args:
        answers: v4l2_queryctrl by control, in hexadecimal.
        errors: what setting a control ends with.
    """

    def __init__(self, answers: dict[int, str] = WEBCAM, errors: dict[int, int] | None = None) -> None:
        self.answers = {control: bytearray.fromhex(text) for control, text in answers.items()}
        self.errors = errors or {}
        self.is_there = True
        self.told: list[bytes] = []

    def __call__(self, descriptor: int, request: int, content: bytearray) -> int:
        control = int.from_bytes(content[:4], "little")
        fault = errno.ENODEV if not self.is_there else 0
        if request == VIDIOC_QUERYCTRL:
            assert len(content) == 68
            fault = fault or (0 if control in self.answers else errno.EINVAL)
            if not fault:
                content[:] = self.answers[control]
        else:
            assert request == VIDIOC_S_CTRL
            assert len(content) == 8
            fault = fault or self.errors.get(control, 0)
            self.told += [] if fault else [bytes(content)]
        if fault:
            raise OSError(fault, os.strerror(fault))
        return 0

    def values(self) -> list[tuple[int, int]]:
        """What was set, in order."""
        return [struct.unpack("<Ii", content) for content in self.told]


@pytest.fixture
def device(tmp_path: Path) -> Path:
    path = tmp_path / "video0"
    path.touch()
    return path


@pytest.fixture
def plug(device: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., V4l2Controls]]:
    """Opens the device of a kernel; motion allows a second. All are closed at the end."""
    opened = []

    def plug_in(kernel: Kernel, allowed: float = 1.0) -> V4l2Controls:
        monkeypatch.setattr("fcntl.ioctl", kernel)
        opened.append(V4l2Controls(device, allowed))
        return opened[-1]

    yield plug_in
    for camera in opened:
        camera.close()


def test_a_webcam_is_told_ticks_and_its_own_gain(plug) -> None:
    kernel = Kernel()
    camera = plug(kernel)
    assert kernel.values() == [(Control.EXPOSURE_AUTO, 1)]
    assert camera.refused == ()
    assert camera.reach == Reach(pytest.approx(300e-6), pytest.approx(204.7e-3), GREATEST_GAIN)
    assert camera.adjust(SETTING) == camera.adjust(Setting(1e-6, 1.0)) == ()
    assert kernel.told[1].hex() == "02099a0028000000"  # v4l2_control as gcc lays it out
    exposure, gain = Control.EXPOSURE_ABSOLUTE, Control.GAIN
    assert kernel.values()[1:] == [(exposure, 40), (gain, 255), (exposure, 3), (gain, 0)]


@pytest.mark.parametrize("flag", [DISABLED, READ_ONLY])
def test_a_control_that_cannot_be_set_counts_as_missing(plug, flag: int) -> None:
    kernel = Kernel()
    kernel.answers[Control.GAIN][FLAGS_AT] |= flag
    assert plug(kernel).reach.greatest_gain == 1.0
    kernel.answers[Control.EXPOSURE_ABSOLUTE][FLAGS_AT] |= flag
    camera = plug(kernel)
    assert camera.reach is None
    assert camera.adjust(SETTING) == ()


@pytest.mark.parametrize("fault", [errno.EBUSY, errno.EIO])
def test_a_control_that_refuses_is_named_and_asked_again(plug, fault: int) -> None:
    kernel = Kernel(errors={Control.EXPOSURE_ABSOLUTE: fault})
    camera = plug(kernel)
    assert camera.adjust(SETTING) == (f"exposure_absolute=40: the driver says {os.strerror(fault)}",)
    assert kernel.values()[-1] == (Control.GAIN, 255)
    kernel.errors.clear()
    assert camera.adjust(SETTING) == ()
    assert (Control.EXPOSURE_ABSOLUTE, 40) in kernel.values()


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_device_that_is_gone_is_told_and_let_go_of(device: Path, plug) -> None:
    kernel = Kernel()
    camera = plug(kernel)
    kernel.is_there = False
    with pytest.raises(VisionError, match=r"video0 is gone \(No such device\)"):
        camera.adjust(SETTING)
    before = open_files()
    with pytest.raises(VisionError, match="is gone"):
        plug(kernel)
    assert open_files() == before
    with pytest.raises(VisionError, match="cannot be opened a second time"):
        V4l2Controls(device.parent / "video1", 1.0)


class Webcam:
    """What OpenCV makes of the device: images until it is unplugged."""

    opened = 0

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        Webcam.opened += 1

    def isOpened(self) -> bool:
        return True

    def get(self, control: int) -> float:
        return 0.0

    def set(self, control: int, value: float) -> bool:
        return True

    def read(self) -> tuple[bool, np.ndarray | None]:
        return (True, np.zeros((8, 8, 3), np.uint8)) if self._kernel.is_there else (False, None)

    def release(self) -> None:
        Webcam.opened -= 1


def test_images_go_on_whatever_the_camera_refuses_and_end_when_it_is_unplugged(
    device: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = {Control.AUTOGAIN: errno.EACCES, Control.EXPOSURE_ABSOLUTE: errno.EBUSY}
    kernel = Kernel(WEBCAM | AUTOMATIC_GAIN, errors)
    monkeypatch.setattr(cv2, "VideoCapture", lambda *_: Webcam(kernel))
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: True)
    monkeypatch.setattr("fcntl.ioctl", kernel)
    cfg = CameraSection(source=f"v4l2:{device}", exposure_ms="target", reopen_min=0.01)
    stream = CameraStream(cfg, source_of(cfg), NewestSlot[CameraImage]())
    stream.start()
    wait_for_status(stream, lambda s: s.images >= 1)
    control = stream.status().control
    control.setting = SETTING
    busy = (
        "autogain=0: the driver says Permission denied",
        "exposure_absolute=40: the driver says " + os.strerror(16),
    )
    status = wait_for_status(stream, lambda s: s.settings_refused == busy)
    assert (status.state, status.reopened) == (EyeState.OK, 0)
    kernel.errors.clear()
    control.setting = SETTING._replace()
    wait_for_status(stream, lambda s: s.settings_refused == busy[:1])
    kernel.is_there = False
    wait_for_status(stream, lambda s: s.reopened >= 2)  # it cannot be opened either, and nothing stays open
    kernel.is_there = True
    wait_for_status(stream, lambda s: s.state is EyeState.OK)
    stream.stop()
    assert Webcam.opened == 0
