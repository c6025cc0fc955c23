"""What a camera meets outdoors and indoors beside light: fog, rain, propellers, lamps, an analog link, hands and feet.

A lens of 120 degrees and a rolling shutter on a shaking frame, told and untold, are flown with them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import pi, radians
from typing import Final

import numpy as np
import numpy.typing as npt

from lab.vision.flight import VGA, Device
from lab.vision.real import RESPONSE
from lab.vision.weather import SKIES, Change, Sky
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mksim.scene.analogvideo import AnalogVideo
from mksim.scene.hindrances import Drops, Flicker, Fog, Propellers
from mksim.scene.light import Cover, LightConditions
from mksim.scene.view import CameraView

Array = npt.NDArray[np.float64]

READOUT: Final = 0.025
LINE_TIME: Final = READOUT / VGA.height
FRAME_HZ: Final = 85.0
"""Of the vibration of a quadrotor's frame: motors at 5100 revolutions a minute."""
SHAKEN: Final = radians(1.0) * 2.0 * pi
"""Its angular rate, deviation of each axis [rad/s]; chosen."""
WIDE: Final = Intrinsics(
    width=640, height=480, fx=305.6, fy=305.6, cx=319.5, cy=239.5, model="fisheye", k1=-0.02, k2=0.004, line_time=0.0
)
"""120 degrees from side to side."""
UNTOLD: Final = VGA.model_copy(update={"line_time": None})
ROLLING: Final = VGA.model_copy(update={"line_time": LINE_TIME})
ROLLS: Final = Device(exposure_time=0.001, line_time=LINE_TIME, response=RESPONSE)
"""In the sun: the shutter is open for a millisecond."""
LIT_BY_LAMPS: Final = Device(exposure_time=0.002, line_time=LINE_TIME, response=RESPONSE)
SHAKES: Final = Device(line_time=LINE_TIME, vibration=SHAKEN, vibration_hz=FRAME_HZ, response=RESPONSE)
SKIN, LEATHER = 0.45, 0.07
"""Reflectance of a hand and of a shoe."""


def _fog(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """6 to 12 m of visibility: at 4.5 m 5 to 23 % of the contrast are left."""
    fog = Fog(float(rng.uniform(6.0, 12.0)))
    return lambda _view, fair: replace(fair, fog=fog)


def _rain(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    drops = Drops(int(rng.integers(1 << 30)))
    return lambda _view, fair: replace(fair, drops=drops)


def _propellers(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    rate, first, second = rng.uniform(70.0, 100.0), rng.uniform(0.0, pi), rng.uniform(0.0, pi)
    blades = Propellers(float(rate), (float(first), float(second)))
    return lambda _view, fair: replace(fair, propellers=blades)


def _lamps(rng: np.random.Generator, _side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """Lamps that are dimmed by switching them, 150 to 300 times a second."""
    flicker = Flicker(float(rng.uniform(150.0, 300.0)), 0.8, float(rng.uniform(0.0, 2 * pi)))
    return lambda _view, fair: replace(fair, flicker=flicker)


def _analog(noise: float, disturbed: float) -> Change:
    video = AnalogVideo(noise, disturbed)
    return lambda _rng, _side: lambda _view, fair: replace(fair, analog=video)


def _over_a_side(
    rng: np.random.Generator, outlines: Sequence[Array], shade: float, side: float
) -> Callable[[CameraView, LightConditions], LightConditions]:
    """Something that lies over one side of the target and goes to and fro by a tenth of it.

    Args:
        rng: draws which side, where on it and when it moves.
        outlines: of it, rooted at (0, 0) and pointing along y, each `(n, 2)` [m].
        shade: its reflectance.
        side: of the largest tag [m]; it lies over a fifth to a half of it.
    """
    quarter, along, phase = int(rng.integers(4)) * pi / 2, rng.uniform(-0.25, 0.25) * side, rng.uniform(0.0, 2 * pi)
    lean, reach = rng.normal(0.0, 0.2), rng.uniform(0.2, 0.5)
    turn, leaning = (np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in (quarter, lean))

    def change(view: CameraView, fair: LightConditions) -> LightConditions:
        tip = -side * (0.5 - reach - 0.05 * np.sin(2 * pi * 0.4 * view.time + phase))
        placed = [(outline @ leaning.T + (along, tip)) @ turn.T for outline in outlines]
        covers = tuple(Cover(tuple((float(x), float(y)) for x, y in outline), shade) for outline in placed)
        return replace(fair, covers=covers)

    return change


def _ellipse(middle: tuple[float, float], half: tuple[float, float]) -> Array:
    angles = np.linspace(0.0, 2 * pi, 24, endpoint=False)
    return np.column_stack([np.cos(angles), np.sin(angles)]) * half + middle


def _hand(rng: np.random.Generator, side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """Four fingers, thumb and palm; their tips lie at the origin."""
    tips = ((-0.03, -0.01), (-0.01, 0.0), (0.01, -0.003), (0.03, -0.02))
    fingers = [_ellipse((x, y - 0.045), (0.009, 0.045)) for x, y in tips]
    hand = [*fingers, _ellipse((0.0, -0.13), (0.045, 0.055)), _ellipse((0.05, -0.11), (0.012, 0.04))]
    return _over_a_side(rng, hand, SKIN, side)


def _foot(rng: np.random.Generator, side: float) -> Callable[[CameraView, LightConditions], LightConditions]:
    """A shoe of 0.29 m; its toe lies at the origin."""
    shoe = [_ellipse((0.0, -0.07), (0.05, 0.07)), _ellipse((0.0, -0.2), (0.042, 0.09))]
    return _over_a_side(rng, shoe, LEATHER, side)


TRIALS: Final = {
    "fog": Sky(_fog),
    "rain": Sky(_rain),
    "propellers": Sky(_propellers, ROLLS, lens=ROLLING),
    "lamps": Sky(_lamps, LIT_BY_LAMPS, lens=ROLLING),
    "analog": Sky(_analog(6.0, 0.1)),
    "analog_bad": Sky(_analog(14.0, 0.5)),
    "hand": Sky(_hand),
    "foot": Sky(_foot),
    "wide_lens": Sky(SKIES["fair"].change, lens=WIDE),
    "rolling_told": Sky(SKIES["fair"].change, SHAKES, lens=ROLLING),
    "rolling_untold": Sky(SKIES["fair"].change, SHAKES, lens=UNTOLD),
}
"""By name."""
