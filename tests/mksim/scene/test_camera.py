"""The simulated camera: true poses are found in it, faults show, frames come stamped and late as configured."""

from __future__ import annotations

import struct
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.clock import boot_id
from mkdaemon.errors import ConfigError
from mkdaemon.frames import rotation_from_euler
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.still import StillEye, StillResult
from mkdaemon.vision.tags.tagmap import TagMap
from mksim.config import FlightConfig, LightConfig, PilotPlan, PlatformConfig, SceneConfig, SimConfig
from mksim.faults import RunningFaults
from mksim.physics.truth import Truth
from mksim.physics.world import StartState, World
from mksim.scene.camera import BUILT_IN, BodyState, SceneCamera, landing_world, platform_of
from mksim.scene.feed import SceneFeed
from mksim.scene.outputs import VIDIOC_S_FMT, LoopWriter, VideoWriter, loop_format
from mksim.simulation import Simulation
from tests.places import CONFIGS

TURNED = rotation_from_euler(0.1, -0.08, 0.7)
PATIENCE = 60.0
"""Longest wait for the renderer [s]; a loaded machine is slow, not wrong."""


def state(height: float = 1.5, moved: float = 0.1, at: float = 0.0, spin: float = 0.0) -> BodyState:
    return BodyState(at, np.array([moved, -0.1, height]), np.array([0.3, 0.0, 0.0]), TURNED, np.array([0, 0, spin]))


def look(camera: SceneCamera, pixels: np.ndarray) -> StillResult:
    return StillEye(tagmap=TagMap(camera.targets)).look(pixels, camera.camera.intrinsics)


def vehicle_of(camera: SceneCamera, result: StillResult) -> np.ndarray:
    """Body origin in the target frame, from the measured pose and the mount."""
    pose = result.poses[0].pose
    seen = -pose.rotation.T @ pose.position
    body_turn = pose.rotation.T @ np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]])
    return seen - body_turn @ np.array(camera.camera.mount.position_flu)


def test_the_pose_in_the_image_is_the_true_state() -> None:
    camera = SceneCamera(SceneConfig(camera=CONFIGS / "cameras" / "sim.toml"), seed=1)
    assert camera.camera.mount.position_flu != (0.0, 0.0, 0.0)
    result = look(camera, camera.expose(state()))
    np.testing.assert_allclose(vehicle_of(camera, result), state().position_enu, atol=0.006)


def test_the_shipped_camera_file_is_the_built_in_camera() -> None:
    assert load_camera(CONFIGS / "cameras" / "sim.toml").intrinsics == BUILT_IN.intrinsics


def test_the_target_moves_with_its_platform() -> None:
    cfg = SceneConfig(platform=PlatformConfig(kind="straight", speed=0.2, heading_deg=90.0))
    camera = SceneCamera(cfg, seed=1)
    offsets = []
    for at in (0.0, 1.0):
        result = look(camera, camera.expose(state(at=at)))
        pose = camera.platform.pose_at(at)
        offsets.append(pose.points(vehicle_of(camera, result)[None])[0])
        np.testing.assert_allclose(offsets[-1], state().position_enu, atol=0.006)
    assert platform_of(cfg.platform).pose_at(1.0).position_enu[1] == pytest.approx(0.2)


def test_a_camera_off_the_centre_moves_when_the_body_turns() -> None:
    camera = SceneCamera(SceneConfig(camera=CONFIGS / "cameras" / "sim.toml"), seed=1)
    spun = camera.view(state(spin=2.0))
    still = camera.view(state())
    turn = spun.velocity_enu - still.velocity_enu
    arm = TURNED @ np.array(camera.camera.mount.position_flu)
    np.testing.assert_allclose(turn, np.cross(TURNED @ [0, 0, 2.0], arm), atol=1e-12)
    assert spun.rate_cam[2] == pytest.approx(-2.0)  # looking down, nose to the left turns against the image


def test_faults_take_the_light_and_hide_the_target() -> None:
    camera = SceneCamera(SceneConfig(), seed=1)
    fair = camera.expose(state())
    assert camera.expose(state(), light=0.02).mean() < 0.05 * fair.mean()
    assert len(look(camera, fair).tags) == 2
    assert len(look(camera, camera.expose(state(), covered=1.0)).tags) == 0
    assert len(look(camera, camera.expose(state(), covered=0.5)).tags) < 2


def test_light_follows_its_configuration() -> None:
    light = LightConfig(exposure=0.5, noise_sd=4.0, gradient=3.0, shadow_ratio=4.0, glare=0.1, jpeg_quality=30)
    conditions = SceneCamera(SceneConfig(light=light), seed=1).conditions(5.0, light=0.5, covered=0.3)
    assert conditions.exposure == 0.25
    assert (conditions.noise_sd, conditions.gradient, conditions.jpeg_quality) == (4.0, 3.0, 30)
    assert conditions.shadow is not None
    assert len(conditions.glare) == len(conditions.covers) == 1


def test_a_webcam_rolls_its_shutter_and_finds_its_own_exposure() -> None:
    light = LightConfig(exposure=0.2, leaves_height=3.0, vehicle_shadow=True)
    camera = SceneCamera(SceneConfig(kind="c270", light=light), seed=1)
    assert camera.view(state()).line_time == pytest.approx(30e-3 / 480)
    leaves = camera.conditions(0.5).leaves
    assert leaves.shift != (0.0, 0.0)
    means = [float(camera.expose(state()).mean()) for _ in range(8)]
    assert means[-1] > 1.2 * means[0]


def truth_at(height: float) -> Truth:
    return World(FlightConfig(), seed=1, start=StartState(height=height)).truth


def test_the_aircraft_is_carried_by_the_platform_it_stands_on() -> None:
    platform = PlatformConfig(kind="ramp", speed=0.3, acceleration=0.3, heading_deg=90.0, start_enu=(0.0, 0.0, 0.2))
    config = SimConfig(scene=SceneConfig(enabled=True, platform=platform))
    world = landing_world(config)
    assert world is not None
    simulation = Simulation(config.model_copy(update={"pilot_plan": PilotPlan.NOTHING}), world)
    simulation.advance(3.0)
    deck = platform_of(platform).pose_at(3.0).position_enu
    east, north, up = simulation.world.truth.position_enu
    assert north == pytest.approx(deck[1], abs=0.05)
    assert deck[1] == pytest.approx(0.75)
    assert abs(east) < 0.02
    assert up == pytest.approx(0.2 + config.flight.airframe.leg_height, abs=0.03)
    assert landing_world(SimConfig()) is None


def test_frames_come_stamped_and_late() -> None:
    cfg = SceneConfig(latency_ms=80.0, latency_jitter_ms=0.0, stamp_error_ms=5.0, fps=30.0, name="nose")
    frames: list[tuple[float, CameraFrame]] = []
    enough = threading.Event()

    def send(frame: CameraFrame) -> None:
        frames.append((time.monotonic(), frame))
        if len(frames) == 4:
            enough.set()

    feed = SceneFeed(SceneCamera(cfg, seed=1), send, seed=1)
    truth, faults = truth_at(1.5), RunningFaults()
    feed.start()
    exposed = []
    for k in range(4):
        before = time.monotonic()
        feed.tick(k / 30.0, truth, faults)
        feed.tick(k / 30.0 + 0.001, truth, faults)  # not due
        exposed.append((before, time.monotonic()))
        feed._slot.wait_taken("")
    assert enough.wait(PATIENCE)
    feed.stop()
    for k, (arrived, frame) in enumerate(frames):
        assert (frame.sequence, frame.camera, frame.stamp.boot) == (k + 1, "nose", boot_id())
        taken = frame.stamp.monotonic - 0.005
        assert exposed[k][0] <= taken <= exposed[k][1]
        assert arrived - taken >= 0.0799
        assert (frame.width, frame.height, len(frame.pixels)) == (640, 480, 640 * 480)
    assert feed.render_ms > 0.0
    assert feed.dropped == 0


def test_a_camera_that_is_off_takes_no_picture_and_a_renderer_that_falls_behind_loses_numbered_frames() -> None:
    feed = SceneFeed(SceneCamera(SceneConfig(), seed=1), lambda payload: None, seed=1)
    truth, faults = truth_at(1.5), RunningFaults()
    faults.start("camera_off")
    feed.tick(0.0, truth, faults)
    assert feed._slot.take(0.0) is None
    faults.stop("camera_off")
    feed.tick(0.1, truth, faults)
    assert feed._slot.take(0.0) is not None
    for k in range(6, 11):
        feed.tick(k / 30.0 + 1e-9, truth, faults)
    assert feed.dropped == 4
    feed.stop()


def test_a_video_is_what_was_rendered(tmp_path: Path) -> None:
    writer = VideoWriter(tmp_path / "flight.avi", 640, 480, 30.0)
    pixels = SceneCamera(SceneConfig(), seed=1).expose(state())
    writer.write(pixels)
    writer.close()
    capture = cv2.VideoCapture(str(tmp_path / "flight.avi"))
    found, image = capture.read()
    capture.release()
    assert found
    assert np.abs(image[:, :, 0].astype(int) - pixels).max() <= 2


def test_a_loop_device_is_told_its_format(tmp_path: Path) -> None:
    told = []
    device = tmp_path / "video9"
    device.write_bytes(b"")
    writer = LoopWriter(device, 64, 48, ioctl=lambda fd, request, fmt: told.append((request, fmt)))
    writer.write(np.full((48, 64), 7, np.uint8))
    writer.close()
    writer.close()
    assert device.read_bytes() == bytes([7]) * 64 * 48
    ((request, fmt),) = told
    assert request == VIDIOC_S_FMT
    assert len(fmt) == (request >> 16) & 0x3FFF == 208
    kind, width, height, code, _, line, size = struct.unpack_from("<I4x6I", fmt)
    assert (kind, width, height, code.to_bytes(4, "little"), line, size) == (2, 64, 48, b"GREY", 64, 64 * 48)
    assert loop_format(64, 48) == fmt
    with pytest.raises(ConfigError, match="modprobe v4l2loopback"):
        LoopWriter(tmp_path / "none", 64, 48)


def test_wrong_files_are_configuration_errors() -> None:
    with pytest.raises(ConfigError, match=r"camera file none\.toml"):
        SceneCamera(SceneConfig(camera=Path("none.toml")), seed=1)
    with pytest.raises(ConfigError, match=r"target file none\.toml"):
        SceneCamera(SceneConfig(targets=(Path("none.toml"),)), seed=1)
