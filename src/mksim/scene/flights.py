"""Random flights over a target, with everything that makes tag detection hard: the input of the vision campaign."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mkdaemon.frames import euler_from_rotation, rotation_from_euler
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mksim.scene.light import Cover, Glare, LightConditions, Shadow
from mksim.scene.view import CameraView, rotation_from_vector

Array = npt.NDArray[np.float64]

FLU_FROM_CAM_DOWN: Array = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""A camera looking down from the body, top of its image to the nose: body FLU from camera RDF."""
LOWEST_M = 0.35
HIGHEST_M = 4.5
SHAKE_DEG = 0.7
"""Standard deviation of the attitude jitter from image to image [deg]."""


@dataclass(frozen=True, slots=True)
class FlightFrame:
    """One image of a flight, ready to be rendered.

    Attributes:
        view: camera at mid exposure; `view.time` counts from the start of the flight.
        conditions: light, covers, noise.
        enu_from_flu: true attitude of the vehicle `(3, 3)`; the camera is `FLU_FROM_CAM_DOWN` in it, at its origin.
    """

    view: CameraView
    conditions: LightConditions
    enu_from_flu: Array


@dataclass(frozen=True, slots=True)
class _Wave:
    """A smooth bounded signal: three sines of random phase."""

    amplitude: float
    rates: Array
    phases: Array

    def at(self, time: float) -> float:
        return self.amplitude * float(np.sin(self.rates * time + self.phases).mean()) * 1.5


def _wave(rng: np.random.Generator, amplitude: float, slowest_s: float) -> _Wave:
    periods = slowest_s * np.array([1.0, 0.62, 0.41]) * rng.uniform(0.85, 1.2, 3)
    return _Wave(amplitude, 2 * np.pi / periods, rng.uniform(0, 2 * np.pi, 3))


def random_flight(
    seed: int,
    intrinsics: Intrinsics,
    *,
    tag_size: float,
    duration: float = 8.0,
    rate_hz: float = 15.0,
    exposure_time: float = 0.006,
    lowest: float = LOWEST_M,
    highest: float = HIGHEST_M,
    shake_deg: float = SHAKE_DEG,
    hard: bool = True,
) -> Iterator[FlightFrame]:
    """Fly above a target that lies at the origin of the world.

    The height swings between `lowest` and `highest`; position, yaw and tilt wander; the tilt partly follows the
    target, as a hovering vehicle's does. With `hard`, occlusion by a band, patches, a moving glare, a hard shadow and
    strong blur occur, each for part of the flight.

    Args:
        seed: equal seeds give equal flights.
        intrinsics: camera under the vehicle, looking down.
        tag_size: side of the black square of the outer tag [m]; sizes of covers and glare follow it.
        duration: [s].
        rate_hz: images a second.
        exposure_time: shutter time [s].
        lowest: smallest height [m].
        highest: greatest height [m].
        shake_deg: jitter of the attitude from image to image, each axis [deg].
        hard: let conditions change; otherwise the weather stays fair.

    Yields:
        One frame per image.
    """
    rng = np.random.default_rng([seed, 0xF117])
    way = _Way(rng, lowest, highest)
    weather = _Weather(rng, tag_size, duration)
    for k in range(int(duration * rate_hz)):
        time = k / rate_hz
        jitter = rotation_from_vector(np.radians(rng.normal(0.0, shake_deg, 3)))
        enu_from_flu = way.attitude(time) @ jitter
        view = CameraView(
            intrinsics,
            enu_from_flu @ FLU_FROM_CAM_DOWN,
            way.place(time),
            velocity_enu=way.velocity(time),
            rate_cam=FLU_FROM_CAM_DOWN.T @ (way.rates(time) + np.radians(rng.normal(0.0, 15.0, 3))),
            exposure_time=exposure_time * (2.5 if hard and weather.is_blurred(time) else 1.0),
            time=time,
        )
        yield FlightFrame(view, weather.at(time) if hard else LightConditions(), enu_from_flu)


class _Way:
    """Where the vehicle is and how it lies, without its jitter."""

    _STEP = 1e-3
    """Differences are taken this far to either side [s]."""

    def __init__(self, rng: np.random.Generator, lowest: float, highest: float) -> None:
        self._lowest, self._highest = lowest, highest
        self._sway = [_wave(rng, 1.0, 7.0), _wave(rng, 1.0, 6.0)]
        self._climb, self._turn = _wave(rng, 1.0, 9.0), _wave(rng, 1.2, 8.0)
        self._tilt = [_wave(rng, math.radians(6.0), 4.0), _wave(rng, math.radians(6.0), 3.5)]
        self._heading = rng.uniform(-np.pi, np.pi)

    def place(self, time: float) -> Array:
        share = 0.5 + 0.5 * float(np.clip(self._climb.at(time), -1.0, 1.0))
        height = self._lowest * (self._highest / self._lowest) ** share
        reach = 0.12 * height
        return np.array([reach * self._sway[0].at(time), reach * self._sway[1].at(time), height])

    def velocity(self, time: float) -> Array:
        return (self.place(time + self._STEP) - self.place(time - self._STEP)) / (2 * self._STEP)

    def attitude(self, time: float) -> Array:
        heading = self._heading + self._turn.at(time)
        return rotation_from_euler(self._tilt[0].at(time), self._tilt[1].at(time), heading)

    def rates(self, time: float) -> Array:
        """Turn rates in the body [rad/s]."""
        spin = self.attitude(time - self._STEP).T @ self.attitude(time + self._STEP)
        turned = np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]])
        return turned / (4 * self._STEP)


class _Weather:
    """Which hardship rules when: each has its spell, some overlap."""

    def __init__(self, rng: np.random.Generator, tag_size: float, duration: float) -> None:
        self._size = tag_size
        names = ("band", "patches", "glare", "shadow", "blur")
        starts = rng.uniform(0.0, 0.85, len(names)) * duration
        lengths = rng.uniform(0.15, 0.4, len(names)) * duration
        self._spells = {n: (s, s + d) for n, s, d in zip(names, starts, lengths, strict=True)}
        self._band = side_cut(tag_size, float(rng.uniform(0.1, 0.25)), int(rng.integers(4)))
        self._patches = patches(rng, tag_size, float(rng.uniform(0.05, 0.15)))
        self._glare_from = rng.uniform(-0.5, 0.5, 2) * tag_size
        self._glare_drift = rng.normal(0.0, 0.12, 2) * tag_size
        self._glare_radius = float(rng.uniform(0.05, 0.12)) * tag_size
        self._shadow = Shadow(float(rng.uniform(2.0, 5.0)), direction=float(rng.uniform(-np.pi, np.pi)))
        self._shadow_drift = rng.normal(0.0, 0.05, 2)
        self._calm = LightConditions(exposure=float(rng.uniform(0.6, 1.1)), noise_sd=float(rng.uniform(1.5, 4.0)))

    def is_blurred(self, time: float) -> bool:
        return self._is_active("blur", time)

    def _is_active(self, name: str, time: float) -> bool:
        start, end = self._spells[name]
        return bool(start <= time < end)

    def at(self, time: float) -> LightConditions:
        covers: tuple[Cover, ...] = ()
        if self._is_active("band", time):
            covers += (self._band,)
        if self._is_active("patches", time):
            covers += self._patches
        now = replace(self._calm, covers=covers)
        if self._is_active("glare", time):
            x, y = self._glare_from + self._glare_drift * (time - self._spells["glare"][0])
            now = replace(now, glare=(Glare((float(x), float(y)), self._glare_radius),))
        if self._is_active("shadow", time):
            x, y = self._shadow_drift * (time - self._spells["shadow"][0] - 1.0)
            now = replace(now, shadow=replace(self._shadow, point=(float(x), float(y))))
        return now


def side_cut(tag_size: float, share: float, side: int, reflectance: float = 0.3) -> Cover:
    """Hide `share` of a tag's black square from one side on: 0 right, 1 top, 2 left, 3 bottom of the print."""
    inner, outer = tag_size * (0.5 - share), tag_size * 0.85
    corners = np.array([[inner, -outer], [outer, -outer], [outer, outer], [inner, outer]])
    angle = side * np.pi / 2
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Cover(_polygon(corners @ turn), reflectance)


def patches(rng: np.random.Generator, tag_size: float, share: float, count: int = 4) -> tuple[Cover, ...]:
    """Hide about `share` of a tag's black square under `count` turned rectangles of random shade, anywhere on it."""
    covers = []
    for _ in range(count):
        aspect = float(rng.uniform(0.5, 2.0))
        area = share * tag_size**2 / count
        half = np.array([math.sqrt(area * aspect), math.sqrt(area / aspect)]) / 2
        box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        angle = float(rng.uniform(0, np.pi))
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        covers.append(
            Cover(_polygon(box @ turn + rng.uniform(-0.45, 0.45, 2) * tag_size), float(rng.uniform(0.05, 0.8)))
        )
    return tuple(covers)


def _polygon(corners: Array) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in corners)


def attitude_deg(enu_from_flu: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw [deg] of a vehicle."""
    roll, pitch, yaw = euler_from_rotation(enu_from_flu)
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)
