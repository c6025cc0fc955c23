"""Exposure and gain of a V4L2 camera, against answers laid out by the kernel's own header.

The answers are structures v4l2_queryctrl and v4l2_control as gcc lays them out with linux/videodev2.h of Linux 6 on
x86-64, with names and flags of the driver uvcvideo. Errors are those of Documentation/userspace-api/media/v4l:
VIDIOC_S_CTRL gives EACCES for a read-only control, EBUSY for one that is grabbed, EINVAL for a value that a menu lacks.
"""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.config.camera import CameraSection
from mkdaemon.errors import VisionError
from mkdaemon.telemetry.vision import EyeState
from mkdaemon.vision.camera.camera import CameraStream
from mkdaemon.vision.camera.exposure import GREATEST_GAIN, Control, Reach, Setting, V4l2Controls
from mkdaemon.vision.camera.image import CameraImage, NewestSlot
from mkdaemon.vision.camera.sources import source_of
from tests.vision.streams import wait_for_status

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


Plug = Callable[[Kernel], V4l2Controls]


@pytest.fixture
def plug(device: Path, monkeypatch: pytest.MonkeyPatch) -> Plug:
    """Opens the device of a kernel; motion allows a second."""

    def opened(kernel: Kernel) -> V4l2Controls:
        monkeypatch.setattr("fcntl.ioctl", kernel)
        return V4l2Controls(device, 1.0)

    return opened


def test_a_webcam_is_told_ticks_and_its_own_gain(plug: Plug) -> None:
    kernel = Kernel()
    camera = plug(kernel)
    assert kernel.values() == [(Control.EXPOSURE_AUTO, 1)]
    assert camera.refused == ()
    assert camera.reach == Reach(pytest.approx(300e-6), pytest.approx(204.7e-3), GREATEST_GAIN)
    assert camera.adjust(SETTING) == camera.adjust(Setting(1e-6, 1.0)) == ()
    assert kernel.told[1].hex() == "02099a0028000000"  # v4l2_control as gcc lays it out
    assert kernel.values()[1:] == [
        (Control.EXPOSURE_ABSOLUTE, 40),
        (Control.GAIN, 255),
        (Control.EXPOSURE_ABSOLUTE, 3),
        (Control.GAIN, 0),
    ]
    camera.close()


@pytest.mark.parametrize("flag", [DISABLED, READ_ONLY])
def test_a_control_that_cannot_be_set_counts_as_missing(plug: Plug, flag: int) -> None:
    kernel = Kernel()
    kernel.answers[Control.GAIN][FLAGS_AT] |= flag
    camera = plug(kernel)
    assert camera.reach.greatest_gain == 1.0
    camera.close()
    kernel.answers[Control.EXPOSURE_ABSOLUTE][FLAGS_AT] |= flag
    camera = plug(kernel)
    assert camera.reach is None
    assert camera.adjust(SETTING) == ()
    camera.close()


def test_a_camera_without_exposure_control_takes_nothing(plug: Plug) -> None:
    kernel = Kernel({Control.GAIN: WEBCAM[Control.GAIN]})
    camera = plug(kernel)
    assert camera.reach is None
    assert kernel.told == []
    camera.close()


def test_a_camera_that_keeps_its_automatic_exposure_is_left_to_it(plug: Plug) -> None:
    kernel = Kernel(errors={Control.EXPOSURE_AUTO: errno.EINVAL})  # a menu without manual
    camera = plug(kernel)
    assert camera.refused == ("exposure_auto=1: the driver says Invalid argument",)
    assert camera.reach is None
    assert camera.adjust(SETTING) == ()
    assert kernel.told == []
    camera.close()


def test_a_camera_that_keeps_its_automatic_gain_is_told_exposures_only(plug: Plug) -> None:
    kernel = Kernel(WEBCAM | AUTOMATIC_GAIN, {Control.AUTOGAIN: errno.EACCES})
    camera = plug(kernel)
    assert camera.refused == ("autogain=0: the driver says Permission denied",)
    assert camera.reach.greatest_gain == 1.0
    assert camera.adjust(SETTING) == ()
    assert kernel.values()[-1] == (Control.EXPOSURE_ABSOLUTE, 40)
    camera.close()


@pytest.mark.parametrize("fault", [errno.EBUSY, errno.EACCES, errno.EINVAL, errno.ERANGE, errno.EIO])
def test_a_control_that_refuses_is_named_and_asked_again(plug: Plug, fault: int) -> None:
    kernel = Kernel(errors={Control.EXPOSURE_ABSOLUTE: fault})
    camera = plug(kernel)
    assert camera.adjust(SETTING) == (f"exposure_absolute=40: the driver says {os.strerror(fault)}",)
    assert kernel.values()[-1] == (Control.GAIN, 255)
    kernel.errors.clear()
    assert camera.adjust(SETTING) == ()
    assert (Control.EXPOSURE_ABSOLUTE, 40) in kernel.values()
    camera.close()


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_device_that_is_gone_is_told_and_let_go_of(device: Path, plug: Plug) -> None:
    kernel = Kernel()
    camera = plug(kernel)
    kernel.is_there = False
    with pytest.raises(VisionError, match=r"video0 is gone \(No such device\)"):
        camera.adjust(SETTING)
    camera.close()
    before = open_files()
    with pytest.raises(VisionError, match="is gone"):
        plug(kernel)
    assert open_files() == before
    with pytest.raises(VisionError, match="cannot be opened a second time"):
        V4l2Controls(device.parent / "video1", 1.0)


@pytest.mark.parametrize(("allowed", "longest"), [(5e-3, 5e-3), (1e-9, 300e-6)])
def test_the_longest_exposure_is_at_most_what_motion_allows(
    device: Path, monkeypatch: pytest.MonkeyPatch, allowed: float, longest: float
) -> None:
    monkeypatch.setattr("fcntl.ioctl", Kernel())
    camera = V4l2Controls(device, allowed)
    assert camera.reach.longest == pytest.approx(longest)
    camera.close()


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
