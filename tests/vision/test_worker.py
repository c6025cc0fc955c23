"""Eyes from image to value: true poses on the loop, every unusable stream named, no crash, no pose."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import cache
from itertools import chain, repeat
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.control.sight import view_of
from mkdaemon.errors import ConfigError
from mkdaemon.frames import rotation_from_euler, rotation_from_quaternion
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.vision import Alarm, AttitudeLoss, EyeState, Tags, Transform, VisionPose, VisionStats
from mkdaemon.vision.camera.calibration_file import load_camera, mount_rotation
from mkdaemon.vision.camera.camera import StreamStatus
from mkdaemon.vision.camera.image import CameraImage, NewestSlot
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pipeline import CameraPipeline, pose_of
from mkdaemon.vision.pose.pose import FLOOR_ANGLE, FLOOR_LATERAL, FLOOR_RANGE, Pose
from mkdaemon.vision.tags.targetfile import load
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample, Mounting
from mkdaemon.vision.track.follower import TargetPose
from mkdaemon.vision.worker import VisionWorker
from mksim.scene.light import LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView, view_towards
from tests.places import CONFIGS

CAMERA_FILE = CONFIGS / "cameras" / "sim.toml"
TARGET_FILE = CONFIGS / "targets" / "nested.toml"
CAMERA = load_camera(CAMERA_FILE)
PAD = SceneTarget.of(load([TARGET_FILE]).targets[0], Platform())
STREAMING = StreamStatus(state=EyeState.OK, width=640, height=480)
PATIENCE = 40.0
CLOCK = Clock(monotonic=lambda: 100.05, wall=lambda: 1.7e9 + 100.05)


def view(k: int = 0) -> CameraView:
    return view_towards(CAMERA.intrinsics, np.array([0.2 + 0.01 * k, -0.3, 1.1]), np.zeros(3), turn=0.4)


@cache
def scene() -> Scene:
    return Scene([PAD], ground="tiles", seed=3, fine=False)


def shot(k: int = 0, conditions: LightConditions | None = None) -> np.ndarray:
    return scene().render(view(k), conditions)


def section(**change: object) -> CameraSection:
    base = {"name": "down", "source": "folder:nowhere", "calibration": CAMERA_FILE, "targets": (TARGET_FILE,)}
    return CameraSection.model_validate(base | change)


def image(pixels: np.ndarray, k: int) -> CameraImage:
    return CameraImage(pixels, 100.0 + k / 30, 100.01 + k / 30, k, "down")


def feed(pipeline: CameraPipeline, pictures: list[np.ndarray]) -> list[tuple[str, Telemetry]]:
    values: list[tuple[str, Telemetry]] = []
    for k, pixels in enumerate(pictures):
        values += pipeline.process(image(pixels, k), None)
        pipeline.check_files()
    return values


def poses(values: list[tuple[str, Telemetry]]) -> list[VisionPose]:
    return [value for _, value in values if isinstance(value, VisionPose)]


def stats(pipeline: CameraPipeline, stream: StreamStatus = STREAMING) -> VisionStats:
    return pipeline.stats(stream, CLOCK.stamp())


def test_a_rendered_target_becomes_the_true_pose_of_the_vehicle() -> None:
    values = feed(CameraPipeline(section(), VisionSection(), CLOCK), [shot()])
    assert [suffix for suffix, _ in values] == ["vision/down/tags", "vision/down/pose", "tf"]
    (pose,) = poses(values)
    enu_from_flu = view().enu_from_cam @ mount_rotation(CAMERA.mount).T
    body = view().position_enu - enu_from_flu @ np.array(CAMERA.mount.position_flu)
    np.testing.assert_allclose(pose.position_target, body, atol=0.004)
    turned = rotation_from_quaternion(pose.quaternion_target_from_flu).T @ enu_from_flu
    assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) < 0.2
    back = rotation_from_quaternion(pose.quaternion_flu_from_target)
    np.testing.assert_allclose(back @ np.array(pose.position_target) + pose.position_flu, 0.0, atol=1e-9)
    covariance = np.array(pose.covariance).reshape(6, 6)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-12)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    assert 0.001 < np.sqrt(covariance[2, 2]) < 0.02
    assert pose.latency == pytest.approx(0.05)
    tags = next(value for _, value in values if isinstance(value, Tags))
    assert {tag.id for tag in tags.tags} >= {48} or {tag.id for tag in tags.tags} >= {1}
    edge = next(value for _, value in values if isinstance(value, Transform))
    assert (edge.parent, edge.child) == ("camera/down", "pad")
    np.testing.assert_allclose(edge.translation, pose.position_cam)


@pytest.fixture
def pipeline():
    return CameraPipeline(section(), VisionSection(), CLOCK)


def test_what_a_flight_says_about_the_files_is_in_the_figures(pipeline) -> None:
    pipeline.selfcheck.barometer_received(100.0, 3.0)
    feed(pipeline, [shot(k) for k in range(3)])
    (found,) = stats(pipeline).selfcal
    assert (found.target, found.looks) == ("pad", 1)
    assert stats(pipeline).alarms == {}


BLACK, WHITE = np.zeros((480, 640), np.uint8), np.full((480, 640), 255, np.uint8)
WIDE = np.full((720, 1280), 90, np.uint8)


@pytest.mark.parametrize(
    ("pictures", "change", "state", "words"),
    [
        (lambda: [BLACK] * 8, {}, EyeState.DARK, "lens cap"),
        (lambda: [WHITE] * 8, {}, EyeState.BLOWN, "shorten the exposure"),
        (lambda: [WIDE] * 2, {}, EyeState.WRONG_SIZE, "1280x720, its calibration is for 640x480"),
        (lambda: [shot()[:, :600]] * 2, {}, EyeState.WRONG_SIZE, "600x480, its calibration is for 640x480"),
        (lambda: [shot()], {"calibration": None}, EyeState.UNCALIBRATED, "mkdaemon calibrate camera"),
    ],
    ids=["black", "blown", "mis-sized", "cropped", "uncalibrated"],
)
def test_unusable_images_are_named_and_give_no_pose(
    pictures: Callable[[], list[np.ndarray]], change: dict[str, object], state: EyeState, words: str
) -> None:
    pipeline = CameraPipeline(section(**change), VisionSection(), CLOCK)
    taken = pictures()
    values = feed(pipeline, taken)
    height, width = taken[-1].shape
    found = stats(pipeline, STREAMING._replace(width=width, height=height))
    assert poses(values) == []
    assert (found.state, found.posed, found.faults) == (state, 0.0, 0)
    assert words in found.reason


def test_a_target_file_that_contradicts_the_images_gives_no_pose(tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text(TARGET_FILE.read_text(encoding="utf-8").replace("0.3048", "0.25"), encoding="utf-8")
    pipeline = CameraPipeline(section(targets=(file,)), VisionSection(), CLOCK)
    places = [np.array([0.05 + 0.01 * k, -0.1, 0.5]) for k in range(LIMITS.health.misfit_images + 2)]
    near = [scene().render(view_towards(CAMERA.intrinsics, at, np.zeros(3))) for at in places]
    assert poses(feed(pipeline, near)) == []
    assert stats(pipeline).state is EyeState.TARGET_MISMATCH
    assert "check sizes" in stats(pipeline).reason


def test_a_frozen_camera_stops_giving_poses_and_recovers(pipeline) -> None:
    still = shot()
    assert len(poses(feed(pipeline, [still] * 8))) < 8
    found = stats(pipeline)
    assert found.state is EyeState.FROZEN
    values = pipeline.process(image(still, 9), None)
    assert poses(values) == []
    assert poses(pipeline.process(image(shot(), 10), None))
    assert stats(pipeline).state is EyeState.OK


def test_a_check_of_the_files_that_fails_is_counted_and_costs_no_pose(pipeline, monkeypatch) -> None:
    monkeypatch.setattr(pipeline.selfcheck, "image_seen", Mock(side_effect=cv2.error("inside")))
    assert len(poses(feed(pipeline, [shot(k) for k in range(3)]))) == 3
    assert stats(pipeline).faults == 3


def test_published_pictures_are_bounded_in_rate_and_size() -> None:
    pipeline = CameraPipeline(section(jpeg_hz=10, jpeg_width=320), VisionSection(), CLOCK)
    pixels = np.full((480, 640), 90, np.uint8)
    taken = [frame for k in range(90) if (frame := pipeline.picture(image(pixels, k))) is not None]
    assert 29 <= len(taken) <= 31  # three seconds at 30 Hz
    suffix, frame = taken[0]
    assert isinstance(frame, CameraFrame)
    assert (suffix, frame.width, frame.height, frame.coding) == ("vision/down/image", 320, 240, "jpeg")
    late = pipeline.picture(image(pixels, 300))  # after a pause of seven seconds
    assert late is not None
    assert pipeline.picture(image(pixels, 301)) is None
    assert CameraPipeline(section(), VisionSection(), CLOCK).picture(image(pixels, 0)) is None


class Collected:
    """A sink that remembers, and wakes whoever waits for something."""

    def __init__(self) -> None:
        self.values: list[tuple[str, Telemetry]] = []
        self.threads: set[int] = set()

    def publish(self, suffix: str, value: Telemetry) -> None:
        self.values.append((suffix, value))
        self.threads.add(threading.get_ident())

    async def until(self, wanted: Callable[[list[tuple[str, Telemetry]]], bool]) -> None:
        await wait_until(lambda: wanted(self.values))

    def stats(self) -> list[VisionStats]:
        return [value for _, value in self.values if isinstance(value, VisionStats)]


@pytest.fixture
def source(tmp_path: Path) -> str:
    """A folder with one picture."""
    cv2.imwrite(str(tmp_path / "0.png"), shot())
    return f"folder:{tmp_path}"


@asynccontextmanager
async def supervised(
    before: Callable[[VisionWorker], object] = lambda _: None, **change: object
) -> AsyncIterator[tuple[VisionWorker, Collected]]:
    """A worker of one camera at 50 Hz, and what it publishes."""
    sink, cfg = Collected(), section(fps=50, **change)
    worker = VisionWorker([cfg], VisionSection(), sink.publish, asyncio.get_running_loop(), Clock())
    before(worker)
    worker.start()
    supervision = asyncio.create_task(worker.supervise())
    yield worker, sink
    supervision.cancel()
    worker.stop()


async def test_the_worker_publishes_on_the_loop_from_the_first_image_to_the_last(tmp_path: Path) -> None:
    # The same view six times, with fresh noise: on a starved machine images come at any distance in time, and a camera
    # that moved would seem to jump.
    for k in range(6):
        cv2.imwrite(str(tmp_path / f"{k}.png"), shot())

    def measure(worker: VisionWorker) -> None:
        for roll, pitch in ((0.0, 0.0), (np.nan, 0.0), (0.0, np.inf)):
            worker.attitude_arrived(AttitudeSample(0.0, roll, pitch, 0.0))
        worker.barometer_arrived(0.0, 2.0)

    async with supervised(measure, source=f"folder:{tmp_path}", jpeg_hz=10, jpeg_width=320) as (_, sink):
        await sink.until(lambda _: any(found.state is EyeState.ENDED for found in sink.stats()))
        await sink.until(lambda _: sink.stats()[-1].processed == 6)
    assert sink.threads == {threading.get_ident()}
    sequences = [value.sequence for _, value in sink.values if isinstance(value, VisionPose)]
    # A machine that stands still between two images lets the tracker begin anew, and that image has no pose.
    assert sequences
    assert sequences == sorted(set(sequences) & set(range(1, 7)))
    mounts = [value for _, value in sink.values if isinstance(value, Transform) and value.static]
    assert {(edge.parent, edge.child) for edge in mounts} == {("body", "camera/down")}
    picture = next(value for _, value in sink.values if isinstance(value, CameraFrame))
    assert (picture.width, picture.height) == (320, 240)
    last = sink.stats()[-1]
    assert (last.processed, last.dropped) == (6, 0)
    assert last.posed == 1.0 or len(sequences) < 6
    assert last.detect_p50_ms > 0.0
    assert last.attitude_lost[AttitudeLoss.NOT_A_NUMBER] == 2


async def test_a_camera_that_comes_late_is_waited_for(tmp_path: Path) -> None:
    folder, prepared = tmp_path / "later", tmp_path / "prepared"
    async with supervised(source=f"folder:{folder}", reopen_min=0.02, reopen_max=0.05) as (_, sink):
        await sink.until(lambda _: any(found.state is EyeState.GONE for found in sink.stats()))
        assert "no such folder" in sink.stats()[-1].reason
        prepared.mkdir()
        cv2.imwrite(str(prepared / "0.png"), shot())
        prepared.rename(folder)
        await sink.until(lambda values: bool(poses(values)))


@pytest.mark.parametrize("error", [RuntimeError("no memory"), SystemExit()])
async def test_a_thread_that_died_is_reported_and_started_again(source, monkeypatch, error: BaseException) -> None:
    async with supervised(source=source, loop=True) as (worker, sink):
        await sink.until(lambda _: bool(sink.stats()))
        broken_once = Mock(side_effect=chain([error], repeat(None)))
        monkeypatch.setattr(worker._eyes["down"].pipeline, "picture", broken_once)
        await sink.until(lambda _: any(found.state is EyeState.DEAD for found in sink.stats()))
        dead = next(found for found in sink.stats() if found.state is EyeState.DEAD)
        await sink.until(lambda _: sink.stats()[-1].restarts == 1)
        before = sink.stats()[-1].processed
        await sink.until(lambda _: sink.stats()[-1].processed > before)
        if isinstance(error, RuntimeError):
            assert "RuntimeError: no memory" in dead.reason
            assert sink.stats()[-1].faults >= 1


async def test_a_thread_that_does_not_come_back_is_reported_as_stalled(source, monkeypatch) -> None:
    gate = threading.Event()
    async with supervised(source=source, loop=True) as (worker, sink):
        await sink.until(lambda _: bool(sink.stats()))
        monkeypatch.setattr(worker._eyes["down"].pipeline, "picture", lambda _: gate.wait(PATIENCE) and None)
        await sink.until(lambda _: sink.stats()[-1].state is EyeState.STALLED)
        assert "has not come back from an image for" in sink.stats()[-1].reason
        gate.set()
        await sink.until(lambda _: sink.stats()[-1].state is not EyeState.STALLED)


def test_a_detector_that_fails_on_every_image_is_named(pipeline, monkeypatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(pipeline.tracker, "update", Mock(side_effect=IndexError("index 0 is out of bounds")))
        assert feed(pipeline, [shot()] * 3) == []
    found = stats(pipeline)
    assert (found.state, found.faults, found.posed) == (EyeState.FAILING, 3, 0.0)
    assert "IndexError: index 0 is out of bounds" in found.reason
    feed(pipeline, [shot()])
    assert stats(pipeline).state is EyeState.OK


@pytest.mark.parametrize(("field", "bad"), [("time", np.nan), ("roll", np.inf), ("yaw", np.nan)])
def test_attitudes_that_are_no_numbers_are_left_out(pipeline, field: str, bad: float) -> None:
    good = AttitudeSample(100.0, 0.0, 0.0, 0.0)
    wrong, old = replace(good, **{field: bad}), replace(good, time=-1e9)
    assert len(poses(pipeline.process(image(shot(), 0), AttitudeHistory([wrong, old])))) == 1
    found = stats(pipeline)
    assert (found.faults, found.attitude_lost) == (0, {AttitudeLoss.OUT_OF_REACH: 1})
    assert "s away from the image: poses come from the images alone" in found.alarms[Alarm.ATTITUDE_MISSING]
    assert len(poses(pipeline.process(image(shot(), 1), AttitudeHistory([wrong])))) == 1
    assert "none of the vehicle's attitudes is a number" in stats(pipeline).alarms[Alarm.ATTITUDE_MISSING]


def test_an_attitude_that_contradicts_the_images_is_left_out_counted_and_told(pipeline) -> None:
    wrong = AttitudeHistory([AttitudeSample(100.0, 0.3, 0.4, 0.0)])
    posed = [len(poses(pipeline.process(image(shot(k), k), wrong))) for k in range(7)]
    assert (posed[0], posed[-1]) == (0, 1)
    found = stats(pipeline)
    assert found.attitude_lost[AttitudeLoss.CONTRADICTS] >= 1
    assert "off what the images show of a level target" in found.alarms[Alarm.ATTITUDE_CONTRADICTS]


def test_an_image_without_a_time_is_a_counted_fault(pipeline) -> None:
    timeless = CameraImage(shot(), np.nan, 100.0, 1, "down")
    for _ in range(3):
        assert pipeline.process(timeless, None) == []
    assert (stats(pipeline).faults, stats(pipeline).state) == (3, EyeState.FAILING)
    assert "image 1 has no time" in stats(pipeline).reason


async def test_two_cameras_of_one_name_are_refused() -> None:
    with pytest.raises(ConfigError, match="two cameras are called 'down'"):
        VisionWorker([section(), section()], VisionSection(), Collected().publish, asyncio.get_running_loop(), Clock())


def test_cameras_take_turns() -> None:
    slot: NewestSlot[str] = NewestSlot()
    for text in "abc":
        slot.put(f"1{text}", "first")
    slot.put("2a", "second")
    taken = [slot.take(0.0)]
    slot.put("1d", "first")
    taken += [slot.take(0.0), slot.take(0.0), slot.take(0.0)]
    assert taken == ["1c", "2a", "1d", None]
    slot.close()
    assert slot.take(PATIENCE) is None
    assert (slot.dropped["first"], slot.dropped["second"]) == (2, 0)


DOWN = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Body from camera: it looks down, its top to the front."""


def test_a_camera_without_files_says_what_is_not_known() -> None:
    setup = CameraPipeline(section(calibration=None), VisionSection(), CLOCK).setup(CLOCK.stamp())
    assert (setup.lens, setup.position_flu, setup.quaternion_flu_from_cam) == (None, None, None)


def test_what_all_images_have_in_common_is_told_apart_and_leaves_what_was_measured():
    """Off the middle and leaning: what the image itself does not know of the target's place, in body axes."""
    measured = np.diag([1e-4, 2e-4, 5e-4]) ** 2
    covariance = np.zeros((6, 6))
    covariance[:3, :3], covariance[3:, 3:] = measured, 1e-3**2 * np.eye(3)
    rotation = rotation_from_euler(0.2, -0.1, 0.7) @ np.diag([1.0, -1.0, -1.0])
    found = Pose(rotation, np.array([0.3, -0.2, 2.0]), covariance, "edges", 100, 0.1, 1.0)
    target = TargetPose("pad", "pad", found, 9.0, "image", "predicted", 0.0)
    image = CameraImage(np.zeros((4, 4), np.uint8), 1.0, 1.02, 7, "down", "header")
    pose = pose_of(target, image, Stamp(monotonic=1.0, wall=1.0), Mounting(DOWN, np.zeros(3)), 1.05)
    assert pose.calibration_sd == pytest.approx(
        (FLOOR_RANGE * found.range_m, FLOOR_LATERAL * found.range_m, FLOOR_ANGLE)
    )
    view = view_of(pose)
    left = view.sight_covariance - view.calibration_covariance
    assert left == pytest.approx(DOWN @ measured @ DOWN.T, abs=1e-9)
