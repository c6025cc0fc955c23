"""Random flights over a target, rendered with everything that goes wrong outdoors; each frame knows its truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from lab.vision.troubles import plan_troubles
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.tags.tagmap import Target
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample, Mounting
from mksim.scene.ground import GroundKind
from mksim.scene.light import LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target
from mksim.scene.view import CameraView

Array = npt.NDArray[np.float64]

VGA = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5, line_time=0.0)
"""The camera of every measurement unless said: 56 x 44 degrees."""
LOOKING_DOWN = Mounting(np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), np.zeros(3))
"""It is under the vehicle, and its image has the nose at the top."""
FPS = 30.0
"""Images a second of every flight."""
SHAKE_DEG = 0.7
"""Change of each attitude axis between two images at 30 fps, standard deviation [deg]."""
SHAKE_TIME = 0.05
"""Correlation time of the shaking [s]."""
ATTITUDE_RATE = 50.0
"""Data3D samples a second."""
ATTITUDE_NOISE_DEG = 0.1
ATTITUDE_BIAS_DEG = 0.5
"""Mounting error of roll and pitch that stays for a flight, standard deviation [deg]."""
GROUNDS: tuple[GroundKind, ...] = ("asphalt", "grass", "tiles", "clutter")
LEVEL = Platform()
FAIR = LightConditions()


@dataclass(frozen=True, slots=True)
class Device:
    """A camera beside its lens.

    Attributes:
        conditions: light, noise and processing of an image without troubles.
        exposure_time: of an image without troubles [s].
        line_time: between neighbouring rows [s].
        vibration: angular rate of the vibration, deviation of each axis [rad/s].
        vibration_hz: its frequency [Hz]; of a multirotor's frame, a motor at 7200 revolutions a minute.
        response: of the airframe to what shakes it [s]; with none its angular rate jumps from one moment to the next,
            by 60 degrees/s, and no shutter sees where it will be.
    """

    conditions: LightConditions = FAIR
    exposure_time: float = 0.004
    line_time: float = 0.0
    vibration: float = 0.0
    vibration_hz: float = 120.0
    response: float = 0.0


IDEAL = Device()


class Weather(Protocol):
    """What changes light and lens from image to image."""

    def conditions(self, view: CameraView, fair: LightConditions) -> LightConditions:
        """Conditions of the image of `view`, from those of the camera in fair weather."""

    def image_seen(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Take the image, as a camera's automatics do."""


@dataclass(frozen=True, slots=True, eq=False)
class FlightFrame:
    """One image of a flight and the truth behind it.

    Attributes:
        image: what the camera gave.
        attitude: what the vehicle reported by then and shortly after.
        rotation: camera from target `(3, 3)`.
        position: of the target `(3,)` [m; RDF].
        in_view: share of the largest tag's corners inside the image.
    """

    image: CameraImage
    attitude: AttitudeHistory
    rotation: Array
    position: Array
    in_view: float


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """A smooth way through 0.35-4.5 m that keeps the target in view, and a shaken attitude."""

    rng_phase: Array
    rates: Array
    attitude: Array  # (n, 3) at 200 Hz
    near: float
    far: float

    def view(self, time: float, intrinsics: Intrinsics, exposure_time: float) -> tuple[CameraView, Array]:
        here, roll_pitch_yaw = self._at(time)
        ahead, later = self._at(time + 0.005)
        enu_from_flu = rotation_from_euler(*roll_pitch_yaw)
        enu_from_cam = enu_from_flu @ LOOKING_DOWN.flu_from_cam
        turned = enu_from_cam.T @ rotation_from_euler(*later) @ LOOKING_DOWN.flu_from_cam
        rate = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 0.01
        view = CameraView(intrinsics, enu_from_cam, here, (ahead - here) / 0.005, rate, exposure_time, time)
        return view, roll_pitch_yaw

    def _at(self, time: float) -> tuple[Array, Array]:
        wave = np.sin(self.rates * time + self.rng_phase)
        height = self.near * (self.far / self.near) ** (0.5 + 0.5 * wave[0])
        index = min(int(time * 200), len(self.attitude) - 2)
        share = time * 200 - index
        shaken = (1 - share) * self.attitude[index] + share * self.attitude[index + 1]
        roll, pitch = np.radians(9.0) * wave[1] + shaken[0], np.radians(9.0) * wave[2] + shaken[1]
        yaw = 2.5 * wave[3] + shaken[2]
        # Stand where the unshaken camera, which looks along body down, sees the target near the middle.
        calm = rotation_from_euler(float(roll - shaken[0]), float(pitch - shaken[1]), float(yaw))
        down = calm @ np.array([0.0, 0.0, -1.0])
        off = 0.12 * height * wave[4:6]
        position = np.array([*(off + down[:2] * height / down[2]), height])
        return position, np.array([roll, pitch, yaw])


def make_path(rng: np.random.Generator, seconds: float, near: float, far: float, response: float = 0.0) -> _Path:
    """Draw a way; see `Device` for the response."""
    count = int(seconds * 200) + 8
    keep = np.exp(-0.005 / SHAKE_TIME)
    step = 1 / FPS
    # Ornstein-Uhlenbeck noise whose change over one image has the wanted deviation.
    sd = np.radians(SHAKE_DEG) / np.sqrt(2 * (1 - np.exp(-step / SHAKE_TIME)))
    shaken = np.zeros((count, 3))
    for k in range(1, count):
        shaken[k] = keep * shaken[k - 1] + sd * np.sqrt(1 - keep**2) * rng.standard_normal(3)
    if response > 0.0:
        shaken = _smoothed(shaken, response)
    rates = 2 * np.pi * rng.uniform(0.05, 0.2, 6)
    phase = rng.uniform(0, 2 * np.pi, 6)
    phase[0] = rng.choice([0.0, np.pi])  # starts at the geometric middle, climbing or sinking
    return _Path(phase, rates, shaken, near, far)


def _smoothed(shaken: Array, response: float) -> Array:
    """Shaking at 200 Hz that passed two first-order lags, as large from one image to the next as before."""
    impulse = _lagged(np.eye(1, 400).T, SHAKE_TIME)
    kept = _change(impulse) / _change(_lagged(_lagged(impulse, response), response))
    return kept * _lagged(_lagged(shaken, response), response)


def _lagged(signal: Array, time_constant: float) -> Array:
    """A signal at 200 Hz after a first-order lag."""
    keep = float(np.exp(-0.005 / time_constant))
    lagged = np.empty_like(signal)
    value = np.zeros(signal.shape[1])
    for k, now in enumerate(signal):
        value = keep * value + (1.0 - keep) * now
        lagged[k] = value
    return lagged


def _change(impulse: Array) -> float:
    """Deviation of the change over 35 ms of noise with this response to an impulse."""
    late = np.concatenate([np.zeros((7, 1)), impulse])
    early = np.concatenate([impulse, np.zeros((7, 1))])
    return float(np.linalg.norm(late - early))


def fly(
    target: Target,
    seed: int,
    *,
    seconds: float = 8.0,
    intrinsics: Intrinsics = VGA,
    troubled: bool = True,
    near: float = 0.35,
    far: float = 4.5,
    deck: Platform = LEVEL,
    device: Device = IDEAL,
    weather: Weather | None = None,
) -> Iterator[FlightFrame]:
    """Render one flight.

    Args:
        target: what lies on the ground.
        seed: draws path, ground, troubles and noise.
        seconds: how long.
        intrinsics: what the estimator believes; gives the image size.
        near: least height [m].
        far: greatest height [m].
        deck: how the target lies.
        troubled: occlusion, patches, glare, shadow, defocus, motion blur and dim light come and go.
        device: what the camera does beside its lens.
        weather: changes light and lens from image to image.

    Yields:
        The images in order.
    """
    rng = np.random.default_rng([seed, 0xF117])
    path = make_path(rng, seconds, near, far, device.response)
    placed = SceneTarget.of(target, deck)
    scene = Scene([placed], ground=GROUNDS[seed % 4], seed=seed, fine=False)
    attitude = _reported_attitude(rng, path, seconds, intrinsics)
    plan = plan_troubles(rng, seconds, target.tags[0].size) if troubled else []
    for k in range(int(seconds * FPS)):
        t = (k + 0.5) / FPS
        conditions, exposure = device.conditions, device.exposure_time
        for start, end, drawn, shutter in plan:
            if start <= t < end:
                conditions, exposure = drawn, shutter
        view, _ = path.view(t, intrinsics, exposure)
        shaking = device.vibration * rng.standard_normal(3) if device.vibration > 0.0 else np.zeros(3)
        view = replace(view, line_time=device.line_time, vibration_cam=shaking, vibration_hz=device.vibration_hz)
        rotation, position = cam_from_target(placed, view)
        if weather is not None:
            conditions = weather.conditions(view, conditions)
        pixels = scene.render(view, conditions)
        if weather is not None:
            weather.image_seen(pixels)
        image = CameraImage(pixels, t, t, k, "bench", "driver")
        share = share_in_view(target, rotation, position, intrinsics)
        yield FlightFrame(image, attitude, rotation, position, share)


def _reported_attitude(
    rng: np.random.Generator, path: _Path, seconds: float, intrinsics: Intrinsics
) -> AttitudeHistory:
    """What the flight controller says of its attitude: a constant error and noise."""
    bias = np.radians(ATTITUDE_BIAS_DEG) * np.array([*rng.standard_normal(2), 0.0])
    reported = []
    for t in np.arange(0, seconds, 1 / ATTITUDE_RATE):
        _, rpy = path.view(float(t), intrinsics, 0.0)
        rpy = rpy + bias + np.radians(ATTITUDE_NOISE_DEG) * rng.standard_normal(3)
        reported.append(AttitudeSample(float(t), *(float(a) for a in rpy)))
    return AttitudeHistory(reported)


def share_in_view(target: Target, rotation: Array, position: Array, intrinsics: Intrinsics) -> float:
    """Share of the corners of a target's largest tag inside the image.

    Args:
        target: what is seen.
        rotation: camera from target `(3, 3)`.
        position: of the target `(3,)` [m; RDF].
        intrinsics: of the camera; its distortion is left out.
    """
    seen = target.tags[0].corners @ rotation.T + position
    uv = seen[:, :2] / np.maximum(seen[:, 2:], 1e-3) * intrinsics.fx + (intrinsics.cx, intrinsics.cy)
    inside = (seen[:, 2] > 0) & (uv > 0).all(axis=1) & (uv < (intrinsics.width, intrinsics.height)).all(axis=1)
    return float(inside.mean())
