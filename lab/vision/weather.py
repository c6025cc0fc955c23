"""Flights under one hardship each: sun, leaves, gloss, grass, dusk, a long exposure, dirt, a bent print and others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from lab.vision.flight import VGA, Device
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mksim.scene.autoexposure import AutoExposure, AutoSettings
from mksim.scene.curl import Curl
from mksim.scene.gloss import Gloss
from mksim.scene.hardships import blades
from mksim.scene.lensfaults import Dirt, grey_scale
from mksim.scene.light import LightConditions, Shadow
from mksim.scene.processing import Processing
from mksim.scene.shadows import SUN_OVER_SKY, LeafShadow, VehicleShadow
from mksim.scene.view import CameraView

Change = Callable[[np.random.Generator, float], "Callable[[CameraView, LightConditions], LightConditions]"]
"""Draws a hardship for a target of a size [m]; what it gives changes the conditions of one image."""

RESPONSE: Final = 0.03
"""Of a multirotor's frame to what shakes it [s]."""
PLAIN: Final = Device(response=RESPONSE)
SLOW: Final = Device(exposure_time=0.018, response=RESPONSE)
DUSK: Final = Device(
    LightConditions(exposure=0.06, noise_sd=3.0, shot_gain=0.1), exposure_time=0.008, response=RESPONSE
)
"""6 % of the light at four times the gain: noise of read-out and photons as of a small sensor."""
FRINGE_PX: Final = 2.0
GREY_LENS: Final = VGA.model_copy(
    update={name: getattr(VGA, name) * grey_scale(FRINGE_PX, VGA.width, VGA.height) for name in ("fx", "fy")}
)
"""A lens whose colours are magnified differently, as a calibration with its grey images finds it."""
TONE: Final = Device(LightConditions(processing=Processing(gamma=2.2)), response=RESPONSE)


@dataclass(frozen=True, slots=True)
class Sky:
    """A hardship, the camera that flies through it, and the lens that the eyes take it for."""

    change: Change
    device: Device = PLAIN
    automatic: bool = False
    lens: Intrinsics = VGA


def _sun(rng: np.random.Generator, side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """The hard edge of a building's shadow, which the vehicle's way and the clock carry over the target."""
    direction = float(rng.uniform(0, 2 * np.pi))
    start, drift = rng.uniform(-0.35, 0.35, 2) * side, rng.normal(0.0, 0.02, 2)

    def change(view: CameraView, fair: LightConditions) -> LightConditions:
        point = start + drift * view.time
        return replace(fair, shadow=Shadow(SUN_OVER_SKY, (float(point[0]), float(point[1])), direction))

    return change


def _leaves(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    seed, phase = int(rng.integers(1 << 30)), rng.uniform(0, 2 * np.pi, 2)

    def change(view: CameraView, fair: LightConditions) -> LightConditions:
        sway = 0.05 * np.sin(2 * np.pi * np.array([0.5, 0.37]) * view.time + phase)
        return replace(fair, leaves=LeafShadow(seed, shift=(float(sway[0]), float(sway[1]))))

    return change


def _vehicle(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """The sun up to 17 degrees from where the vehicle hides it."""
    sun = rng.uniform(-0.3, 0.3, 2)

    def change(view: CameraView, fair: LightConditions) -> LightConditions:
        place = view.position_enu[:2] - sun * view.position_enu[2]
        turn = float(np.arctan2(view.enu_from_cam[1, 0], view.enu_from_cam[0, 0]))
        shadow = VehicleShadow(float(view.position_enu[2]), (float(place[0]), float(place[1])), turn)
        return replace(fair, vehicle=shadow)

    return change


def _gloss(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """A glossy coat and a high sun, which it shows to a camera above it."""
    tilt, around = rng.uniform(0.0, 0.3), rng.uniform(0, 2 * np.pi)
    to_sun = (float(tilt * np.cos(around)), float(tilt * np.sin(around)), 1.0)
    return lambda _view, fair: replace(fair, gloss=Gloss(0.06, to_sun))


def _grass(rng: np.random.Generator, side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    covers = blades(rng, side)
    return lambda _view, fair: replace(fair, covers=covers)


def _dirt(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    seed = int(rng.integers(1 << 30))
    return lambda _view, fair: replace(fair, dirt=Dirt(seed))


def _curl(rng: np.random.Generator, side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """1 % of the side: a print on thick paper that lies by itself."""
    sign = float(rng.choice([-1.0, 1.0]))
    curl = Curl(sign * side / (8 * 0.01), float(rng.uniform(0, np.pi)), 1.4 * side)
    return lambda _view, fair: replace(fair, curl=curl)


def _clouds(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """Sun and clouds take turns, six to one, each in 0.3 s."""
    phase, period = float(rng.uniform(0, 1)), float(rng.uniform(1.5, 3.0))

    def change(view: CameraView, fair: LightConditions) -> LightConditions:
        wave = np.sin(2 * np.pi * (view.time / period + phase))
        lit = 0.5 + 0.5 * float(np.clip(2.0 * wave, -1.0, 1.0))
        return replace(fair, exposure=fair.exposure * SUN_OVER_SKY ** (lit - 0.5))

    return change


def _nothing(_rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    return lambda _view, fair: fair


def _bright(_rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    return lambda _view, fair: replace(fair, exposure=1.8)


def _fringe(_rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    return lambda _view, fair: replace(fair, fringe_px=FRINGE_PX)


SKIES: Final = {
    "fair": Sky(_nothing),
    "sun_shadow": Sky(_sun),
    "leaf_shadows": Sky(_leaves),
    "vehicle_shadow": Sky(_vehicle),
    "gloss": Sky(_gloss),
    "grass": Sky(_grass),
    "dark": Sky(_nothing, DUSK),
    "exposure_18_ms": Sky(_nothing, SLOW),
    "over_exposed": Sky(_bright),
    "dirty_lens": Sky(_dirt),
    "fringe": Sky(_fringe, lens=GREY_LENS),
    "curl": Sky(_curl),
    "auto_exposure": Sky(_clouds, TONE, automatic=True),
}
"""Hardships by name."""


class SkyWeather:
    """One flight's hardship.

    Args:
        sky: which.
        seed: draws it.
        side: of the largest tag [m].
        salt: draws apart what has the same seed.
    """

    def __init__(self, sky: Sky, seed: int, side: float, salt: int) -> None:
        self._change = sky.change(np.random.default_rng([seed, salt]), side)
        self._gamma = sky.device.conditions.processing.gamma
        self._auto = AutoExposure(AutoSettings()) if sky.automatic else None

    def conditions(self, view: CameraView, fair: LightConditions) -> LightConditions:
        """Of the image of `view`."""
        found = self._change(view, fair)
        return found if self._auto is None else replace(found, exposure=found.exposure * self._auto.brightness)

    def image_seen(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Let the camera choose its exposure."""
        if self._auto is not None:
            self._auto.image_seen(pixels, self._gamma)
