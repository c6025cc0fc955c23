"""The simulated camera: true poses are found in it, faults show, frames come stamped and late as configured."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from mkdaemon.clock import boot_id
from mkdaemon.frames import rotation_from_euler
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.vision.still import StillEye, StillResult
from mkdaemon.vision.tags.tagmap import TagMap
from mksim.config import FlightConfig, PilotPlan, PlatformConfig, SceneConfig, SimConfig
from mksim.faults import RunningFaults
from mksim.physics.truth import Truth
from mksim.physics.world import StartState, World
from mksim.scene.camera import BodyState, SceneCamera, landing_world, platform_of
from mksim.scene.feed import SceneFeed
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


def test_faults_take_the_light_and_hide_the_target() -> None:
    camera = SceneCamera(SceneConfig(), seed=1)
    fair = camera.expose(state())
    assert camera.expose(state(), light=0.02).mean() < 0.05 * fair.mean()
    assert len(look(camera, fair).tags) == 2
    assert len(look(camera, camera.expose(state(), covered=1.0)).tags) == 0
    assert len(look(camera, camera.expose(state(), covered=0.5)).tags) < 2


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
