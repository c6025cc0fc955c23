"""Office light to night: a camera with a fixed exposure, one that seeks a mean grey, and one that we expose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from lab.vision.flight import LOOKING_DOWN, VGA, Device, fly
from lab.vision.looks import look
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


def fly_night(way: str, lux: float, seed: int, seconds: float = SECONDS) -> dict[str, Any]:
    """One flight with attitude; the settings settle in its first second, which does not count.

    Args:
        way: one of `WAYS`.
        lux: light on the scene.
        seed: draws the flight.
        seconds: how long.
    """
    target, camera = target_named("nested"), NightCamera(lux, way)
    tracker = Tracker(TagMap((target,)), VGA, LOOKING_DOWN)
    images = posed = wrong = 0
    off = []
    for frame in fly(target, seed, seconds=seconds, troubled=False, device=Device(response=RESPONSE), weather=camera):
        result = tracker.update(frame.image, frame.attitude)
        found = result.pose_of(target.name)
        camera.outlines = [detection.corners for detection in result.detections]
        if found is not None:
            corners = target.tags[0].corners @ found.pose.rotation.T + found.pose.position
            seen = corners[:, :2] / corners[:, 2:] * VGA.fx + (VGA.cx, VGA.cy)
            camera.outlines.append(seen)
        if frame.image.captured_at < 1.0 or frame.in_view < 1.0:
            continue
        images += 1
        if found is not None:
            seen_as = look(frame, found)
            posed += 1
            wrong += seen_as.wrong
            off.append(100 * seen_as.off)
    return {
        "images": images,
        "posed": posed,
        "wrong": wrong,
        "off_cm": off,
        "exposure_ms": 1e3 * camera.setting.exposure,
        "gain": camera.setting.gain,
    }


def _sum_up(_quick: bool, parts: Sequence[Part], flights: Sequence[dict[str, Any]]) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for way in WAYS:
        for lux in LUX:
            some = [one for part, one in zip(parts, flights, strict=True) if part.args[:2] == (way, lux)]
            off = [value for one in some for value in one["off_cm"]]
            rows[f"{way}, {lux:g} lux"] = {
                **{name: sum(one[name] for one in some) for name in ("images", "posed", "wrong")},
                "median_cm": round(float(np.median(off)), 3) if off else None,
                "exposure_ms": round(float(np.median([one["exposure_ms"] for one in some])), 2),
                "gain": round(float(np.median([one["gain"] for one in some])), 1),
            }
    return rows


NIGHT: Final = Case(_plan, _sum_up)
"""Posed and wrong by light for three ways to expose."""
