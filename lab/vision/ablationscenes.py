"""What the ablation shows: flights and first images of every kind that the other campaigns have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from lab.vision.cases import draws
from lab.vision.decks import LIES
from lab.vision.flight import VGA, FlightFrame, fly
from lab.vision.real import DEVICES, FAR_M, NEAR_M
from lab.vision.stills import SeedSet, Studio, target_named
from lab.vision.weather import SKIES, SkyWeather
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.track.attitude import AttitudeHistory

Array = npt.NDArray[np.float64]

FPS: Final = 30
NEAR_FLIGHT_M, FAR_FLIGHT_M = (0.35, 4.5), (3.0, 9.0)
COLD_M: Final = (0.15, 0.5, 2.0, 4.57, 8.0, 10.0, 12.0)
STEEP_DEG: Final = (70.0, 78.0, 82.0)
FLIGHT_SECONDS: Final = 4.0
SHORT_SECONDS: Final = 1.5
MET_EVERY: Final = 15
"""Images of a flight from one that is shown as a first one to the next."""
LOOKS: Final = 6
"""At a first image, so that every search has its turn: three of them share every second look."""

FLOWN: Final = ("flights", "far", "cameras", "hardships", "decks")
"""Scenes in which a target is followed."""
SCENES: Final = (*FLOWN, "cold", "hidden", "steep", "met")
"""Troubled flights below 4.5 m and from 3 to 9 m; flights behind the cameras of `real`, under the hardships of
`conditions`, over the decks of `decks`; first images by distance, in covers and bad light, from 70 degrees up, and
behind those cameras and under those hardships."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What one part of the campaign shows.

    Attributes:
        scene: one of `SCENES`.
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
    """One image of a setting, with its truth, and how often it is looked at until it is posed."""

    image: CameraImage
    attitude: AttitudeHistory
    rotation: Array
    position: Array
    looks: int


def settings(quick: bool, seeds: SeedSet) -> Iterator[Setting]:
    """All that is shown; see `SCENES`.

    Args:
        quick: a fraction of the images.
        seeds: which scenes.
    """
    flights, seconds, each = (1, SHORT_SECONDS, 3) if quick else (4, FLIGHT_SECONDS, 12)
    base, images = seeds.base, int(FPS * seconds)
    targets, fewer = ("nested", "single"), max(flights // 2, 1)
    for k in range(flights):
        for scene in ("flights", "far"):
            yield from (Setting(scene, name, scene, base + 900 + k, 0, images) for name in targets)
    for k in range(fewer):
        yield from (Setting("cameras", "nested", name, base + 1300 + k, 0, images) for name in DEVICES)
        yield from (Setting("decks", targets[k % 2], name, base + 1200 + k, 0, images) for name in LIES)
    yield from (Setting("hardships", "nested", name, base + 1400, 0, images) for name in SKIES)
    stills: list[tuple[str, str, str | float]] = [("cold", name, metres) for name in targets for metres in COLD_M]
    stills += [("hidden", "nested", condition) for condition in draws(1.0) if condition != "none"]
    stills += [("steep", "single", degrees) for degrees in STEEP_DEG]
    yield from (Setting(*still, base + 950, k, each) for k, still in enumerate(stills))
    yield from (Setting("met", "nested", name, base + 1500, 0, each) for name in (*DEVICES, *SKIES))


def views(setting: Setting) -> Iterator[View]:
    """Render a setting, image by image."""
    if not setting.is_flight and setting.scene != "met":
        yield from _stills(setting)
        return
    every, looks = (MET_EVERY, LOOKS) if setting.scene == "met" else (1, 1)
    for k, frame in enumerate(_frames(setting, every * setting.images / FPS)):
        if k % every == 0:
            yield View(frame.image, frame.attitude, frame.rotation, frame.position, looks)


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
        yield View(still.image, still.attitude, still.rotation, still.position, LOOKS)


def by_scene(all_settings: Sequence[Setting]) -> dict[str, int]:
    """Number of images of every scene."""
    return {scene: sum(one.images for one in all_settings if one.scene == scene) for scene in SCENES}
