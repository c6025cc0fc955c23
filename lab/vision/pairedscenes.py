"""What is shown to two trees: flights and first images of every kind that the other campaigns have."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from lab.vision.cases import draws
from lab.vision.decks import LIES
from lab.vision.flight import VGA, FlightFrame, fly
from lab.vision.real import DEVICES, FAR_M, NEAR_M
from lab.vision.stills import Studio, target_named
from lab.vision.weather import SKIES, SkyWeather
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.track.attitude import AttitudeHistory

Array = npt.NDArray[np.float64]

FPS: Final = 30
NEAR_FLIGHT_M, FAR_FLIGHT_M = (0.35, 4.5), (3.0, 9.0)
FLOWN: Final = ("flights", "far", "cameras", "hardships", "decks")
"""Scenes in which a target is followed: troubled flights below 4.5 m and from 3 to 9 m, flights behind the cameras of
`real`, under the hardships of `conditions`, over the decks of `decks`. Others are first images: cold starts by
distance, hidden ones and steep views."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What one scene shows.

    Attributes:
        scene: one of `FLOWN`, or of first images.
        target: its name.
        which: camera, hardship, deck, condition, distance [m] or tilt [deg].
        seed: draws it.
        part: draws apart what has the same seed.
        images: how many there are.
    """

    scene: str
    target: str
    which: str | float
    seed: int
    part: int
    images: int

    @property
    def is_flight(self) -> bool:
        """Whether the images follow each other; others are looked at as if nothing was known before."""
        return self.scene in FLOWN

    @property
    def lens(self) -> Intrinsics:
        """What the eyes take the camera for."""
        if self.which in SKIES:
            return SKIES[str(self.which)].lens
        if self.which in DEVICES:
            return VGA.model_copy(update={"line_time": DEVICES[str(self.which)].line_time})
        return VGA


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One image of a setting, with its truth."""

    image: CameraImage
    attitude: AttitudeHistory
    rotation: Array
    position: Array


def views(setting: Setting) -> Iterator[View]:
    """Render a setting, image by image."""
    if not setting.is_flight:
        yield from _stills(setting)
        return
    for frame in _frames(setting, setting.images / FPS):
        yield View(frame.image, frame.attitude, frame.rotation, frame.position)


def _frames(setting: Setting, seconds: float) -> Iterator[FlightFrame]:
    """The flight of a setting."""
    target, seed, which = target_named(setting.target), setting.seed, str(setting.which)
    if which in DEVICES:
        device = DEVICES[which]
        return fly(target, seed, seconds=seconds, near=NEAR_M, far=FAR_M, troubled=False, device=device)
    if which in SKIES:
        sky = SKIES[which]
        weather = SkyWeather(sky, seed, target.tags[0].size)
        return fly(target, seed, seconds=seconds, troubled=False, device=sky.device, weather=weather)
    if which in LIES:
        lie = LIES[which]
        return (
            replace(frame, attitude=AttitudeHistory(lie.report(sample) for sample in frame.attitude.samples))
            for frame in fly(target, seed, seconds=seconds, deck=lie.deck)
        )
    near, far = FAR_FLIGHT_M if setting.scene == "far" else NEAR_FLIGHT_M
    return fly(target, seed, seconds=seconds, near=near, far=far)


def _stills(setting: Setting) -> Iterator[View]:
    target, which = target_named(setting.target), setting.which
    studio = Studio(target, setting.seed, fine=False, part=setting.part)
    for _ in range(setting.images):
        rng = studio.rng
        if setting.scene == "hidden":
            conditions = draws(target.tags[0].size)[str(which)](rng)
            still = studio.shoot(float(rng.uniform(0.5, 2.0)), float(rng.uniform(0, 0.7)), conditions, off=0.08)
        elif setting.scene == "steep":
            still = studio.shoot(2.0, float(np.radians(which)), off=0.02)
        else:
            distance = float(which)
            still = studio.shoot(distance, float(rng.uniform(0, 0.7)), off=0.05 if distance < 0.2 else 0.12)
        yield View(still.image, still.attitude, still.rotation, still.position)
