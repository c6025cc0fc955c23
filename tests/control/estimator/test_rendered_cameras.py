"""A camera that looks down and one that looks forward, rendered, through the eyes and the estimator."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection, MountSection
from mkdaemon.config.vision import VisionSection
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import P, T
from mkdaemon.control.estimator.rollback import STEP
from mkdaemon.control.sight import view_of
from mkdaemon.frames import rotation_from_euler
from mkdaemon.telemetry.vision import VisionPose
from mkdaemon.vision.camera.calibration_file import load_camera, mount_rotation
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pipeline import CameraPipeline
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView
from tests.control.estimator.test_estimator import HOVER, MODEL, Plant
from tests.places import CONFIGS
from tests.vision.views import asphalt, shipped

LENS, PAD = CONFIGS / "cameras" / "sim.toml", CONFIGS / "targets" / "nested.toml"
MOUNTS = {
    "down": MountSection(looks="down", position_flu=(0.05, 0.0, -0.05)),
    "forward": MountSection(looks="forward", rpy_deg=(0.0, 55.0, 0.0), position_flu=(0.1, 0.0, 0.0)),
}
FROM = np.array([-0.5, 0.0, 1.6])
"""Where the vehicle hovers, behind and above the target [m]."""
LATE = {"down": 4, "forward": 9}
"""Steps from an exposure to its pose: the forward camera's arrive behind later ones of the other."""


def pipeline(camera: str) -> CameraPipeline:
    """The eyes of one camera."""
    cfg = CameraSection(name=camera, source="zenoh:images", calibration=LENS, targets=(PAD,), mount=MOUNTS[camera])
    return CameraPipeline(cfg, VisionSection(), Clock())


def fly() -> tuple[npt.NDArray[np.float64], Estimator, dict[str, int]]:
    """Errors of the estimate (n, 3) [m], the estimator, and how many poses each camera gave in 1.1 s."""
    eyes = {camera: pipeline(camera) for camera in MOUNTS}
    scene = Scene([SceneTarget.of(shipped("nested"), Platform())], ground=asphalt(), seed=3, fine=False)
    intrinsics = load_camera(LENS).intrinsics
    plant, estimator = Plant(yaw=0.0), None
    attitudes: list[AttitudeSample] = []
    pending: list[tuple[int, VisionPose]] = []
    errors, posed = [], dict.fromkeys(MOUNTS, 0)
    for k in range(round(1.1 / STEP)):
        tilt_x, tilt_y = plant.axes[:, T]
        attitude = rotation_from_euler(-tilt_y, tilt_x, 0.0)
        place = np.array([*plant.axes[:, P], 0.0]) + FROM
        if k % 2 == 0:
            attitudes.append(AttitudeSample(plant.now, -tilt_y, tilt_x, 0.0))
        for camera, eye in eyes.items():
            if k % 8 == list(MOUNTS).index(camera):
                mount = MOUNTS[camera]
                lens = place + attitude @ np.array(mount.position_flu)
                pixels = scene.render(CameraView(intrinsics, attitude @ mount_rotation(mount), lens))
                image = CameraImage(pixels, plant.now, plant.now, k, camera, "header")
                values = [value for _, value in eye.process(image, AttitudeHistory(tuple(attitudes)))]
                poses = [(k + LATE[camera], value) for value in values if isinstance(value, VisionPose)]
                pending += poses
                posed[camera] += len(poses)
        for _, pose in (due for due in pending if due[0] == k):
            estimator = estimator or Estimator(MODEL, view_of(pose), HOVER)
            estimator.advance(plant.now)
            estimator.target_seen(view_of(pose), plant.now)
        if estimator is not None and k % 2 == 0:
            estimator.attitude_received(plant.now, *plant.reported(), 0.0)
            sway = round(3 * math.sin(4.0 * plant.now))
            estimator.sent(plant.stick(sway, -sway))
            if plant.now > 0.6:
                truth = np.array([*plant.axes[:, P], 0.0]) + FROM
                errors.append(estimator.estimate(plant.now).position - truth)
        plant.step()
    assert estimator is not None
    return np.array(errors), estimator, posed


def test_both_cameras_give_one_estimate_of_the_vehicle() -> None:
    errors, estimator, posed = fly()
    assert min(posed.values()) >= 8
    assert estimator.contradicting == ()
    assert estimator.rejected == 0
    assert np.sqrt((errors**2).mean()) < 0.003
