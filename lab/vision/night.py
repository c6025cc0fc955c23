"""Office light to night: a camera with a fixed exposure, one that seeks a mean grey, and one that we expose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from lab.vision.flight import LOOKING_DOWN, VGA, Device, fly
from lab.vision.looks import Look, figures, look
from lab.vision.parts import Case, Part
from lab.vision.stills import SeedSet, target_named
from mkdaemon.vision.camera.exposure import ExposureControl, Reach, Setting
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.electrons import PhotonSensor
from mksim.scene.light import LightConditions
from mksim.scene.view import CameraView

SECONDS: Final = 3.0
LUX: Final = (400.0, 40.0, 10.0, 3.0, 1.0, 0.3)
"""Office, sunset, dusk, street light, deep twilight, full moon."""
SENSOR: Final = PhotonSensor()
REACH: Final = Reach(100e-6, 15e-3, SENSOR.greatest_gain)
FIXED: Final = Setting(4e-3, 4.0)
LONGEST_AUTO: Final = 30e-3
"""Of a camera's own automatics at 30 images a second [s]."""
RESPONSE: Final = 0.03
WAYS: Final = ("fixed", "camera", "target")


class NightCamera:
    """Exposure and gain that act on the image of the next exposure.

    Args:
        lux: light on the scene.
        way: one of `WAYS`.
    """

    def __init__(self, lux: float, way: str) -> None:
        self._lux = lux
        self._way = way
        self._control = ExposureControl(REACH)
        self.setting = self._control.setting if way == "target" else FIXED
        self.outlines: list[npt.NDArray[np.float64]] = []

    def exposed(self, view: CameraView) -> CameraView:
        """The view with the shutter time that acts."""
        return replace(view, exposure_time=self.setting.exposure)

    def conditions(self, _view: CameraView, fair: LightConditions) -> LightConditions:
        """Brightness and noise of the setting that acts."""
        return SENSOR.conditions(fair, self._lux, self.setting.exposure, self.setting.gain)

    def image_seen(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Choose the next setting."""
        if self._way == "camera":
            # Exposure first, then gain: what cameras do that expect no motion.
            wanted = self.setting.exposure * self.setting.gain * (117.0 / max(float(pixels.mean()), 1.0)) ** 0.2
            exposure = min(max(wanted, REACH.shortest), LONGEST_AUTO)
            self.setting = Setting(exposure, min(max(wanted / exposure, 1.0), REACH.greatest_gain))
        elif self._way == "target":
            self._control.image_seen(pixels, self.outlines)
            self.setting = self._control.setting


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    flights = 1 if quick else 4
    return [
        Part(fly_night, (way, lux, seeds.base + 1600 + k), int(30 * SECONDS))
        for way in WAYS
        for lux in LUX
        for k in range(flights)
    ]


def fly_night(way: str, lux: float, seed: int, seconds: float = SECONDS) -> tuple[list[Look], Setting]:
    """One flight with attitude; the settings settle in its first second, which does not count.

    Args:
        way: one of `WAYS`.
        lux: light on the scene.
        seed: draws the flight.
        seconds: how long.

    Returns:
        What was made of the images that show the whole target, and the last setting.
    """
    target, camera = target_named("nested"), NightCamera(lux, way)
    tracker, looks = Tracker(TagMap((target,)), VGA, LOOKING_DOWN), list[Look]()
    for frame in fly(target, seed, seconds=seconds, troubled=False, device=Device(response=RESPONSE), weather=camera):
        result = tracker.update(frame.image, frame.attitude)
        found = result.pose_of(target.name)
        camera.outlines = [detection.corners for detection in result.detections]
        if found is not None:
            corners = target.tags[0].corners @ found.pose.rotation.T + found.pose.position
            camera.outlines.append(corners[:, :2] / corners[:, 2:] * VGA.fx + (VGA.cx, VGA.cy))
        if frame.image.captured_at >= 1.0 and frame.in_view == 1.0:
            looks.append(look(frame, found))
    return looks, camera.setting


def _sum_up(_quick: bool, parts: Sequence[Part], flights: Sequence[tuple[list[Look], Setting]]) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for way, lux in dict.fromkeys(part.args[:2] for part in parts):
        some = [one for part, one in zip(parts, flights, strict=True) if part.args[:2] == (way, lux)]
        rows[f"{way}, {lux:g} lux"] = {
            **figures([one for looks, _ in some for one in looks]),
            "exposure_ms": round(1e3 * float(np.median([setting.exposure for _, setting in some])), 2),
            "gain": round(float(np.median([setting.gain for _, setting in some])), 1),
        }
    return rows


NIGHT: Final = Case(_plan, _sum_up)
"""Posed and wrong by light for three ways to expose."""
