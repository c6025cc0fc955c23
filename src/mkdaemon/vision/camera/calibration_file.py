"""The camera file: what a calibration found, and how the camera sits on the vehicle."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, ValidationError, field_validator, model_validator

from mkdaemon.config.base import Section
from mkdaemon.config.camera import MountSection
from mkdaemon.config.keys import toml_value
from mkdaemon.config.reader import load_section, read_file
from mkdaemon.errors import ConfigError
from mkdaemon.files import save
from mkdaemon.frames import FLU_FROM_RDF, rotation_from_euler
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.camera.foreign import figures_of

FOCAL_SIDES = (0.15, 60.0)
"""Focal lengths there are, in longer sides of the image: from a fish-eye to a telescope."""
MAX_ASPECT = 2.0
"""Ratio of the focal lengths; two with every other line left out."""

_LOOKS_DEG = {"forward": (0, 0), "back": (0, 180), "left": (0, 90), "right": (0, -90), "down": (90, 0), "up": (-90, 0)}
"""Pitch and yaw that turn a camera that looks forward [deg]."""


class Intrinsics(Section):
    """Projection of a camera: RDF axes, pixel centres at integer coordinates.

    Source: OpenCV camera models. `pinhole` has k1, k2, p1, p2, k3 (Brown, Photogrammetric Engineering 37(8), 1971),
    `fisheye` k1 to k4 of the angle from the axis (Kannala and Brandt, PAMI 28(8), 2006).
    """

    width: int = Field(gt=0)
    """Image width the figures hold for [px]."""
    height: int = Field(gt=0)
    """Image height the figures hold for [px]."""
    fx: float = Field(gt=0)
    """Focal length along x [px]."""
    fy: float = Field(gt=0)
    """Focal length along y [px]."""
    cx: float
    """Principal point, x [px]."""
    cy: float
    """Principal point, y [px]."""
    model: Literal["pinhole", "fisheye"] = "pinhole"
    """How the lens bends directions."""
    k1: float = 0.0
    """Radial distortion, second order."""
    k2: float = 0.0
    """Radial distortion, fourth order."""
    p1: float = 0.0
    """Tangential distortion."""
    p2: float = 0.0
    """Tangential distortion."""
    k3: float = 0.0
    """Radial distortion, sixth order."""
    k4: float = 0.0
    """Radial distortion of a fisheye, eighth order."""
    gamma: float = Field(default=1.0, ge=0.5, le=4.0)
    """Tone curve: grey is light to the power 1 / gamma; 1 is a camera that gives light as it is."""
    line_time: float | None = Field(default=None, ge=0, le=1e-3)
    """Between the exposures of neighbouring rows, from the top [s]; 0 is a global shutter. Absent, it is unknown: 0 to
    60 us, in the uncertainty of every pose until images show it."""

    @model_validator(mode="after")
    def _right_coefficients(self) -> Self:
        wrong = ("p1", "p2") if self.model == "fisheye" else ("k4",)
        for name in wrong:
            if getattr(self, name) != 0.0:
                msg = f"{name} has no place in the model {self.model}: leave it out"
                raise ValueError(msg)
        return self

    @property
    def matrix(self) -> Array:
        """Camera matrix `(3, 3)` [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Array:
        """In OpenCV's order: k1, k2, p1, p2, k3 of a pinhole `(5,)`, k1 to k4 of a fisheye `(4,)`."""
        if self.model == "fisheye":
            return np.array([self.k1, self.k2, self.k3, self.k4])
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3])


def mount_rotation(mount: MountSection) -> Array:
    """Body from camera `(3, 3)`, FLU from RDF: the direction of view, turned by the small angles about body axes."""
    small, looks = (
        rotation_from_euler(*map(math.radians, rpy)) for rpy in (mount.rpy_deg, (0, *_LOOKS_DEG[mount.looks]))
    )
    rotation: Array = small @ looks @ FLU_FROM_RDF
    return np.round(rotation, 15) + 0.0


class CalibrationRecord(Section):
    """Source and quality of the intrinsics."""

    date: str = ""
    """Day of the calibration, ISO 8601."""
    lens: str = ""
    """Lens and focus, in the user's words."""
    board: str = ""
    """What was shown to the camera."""
    views: int = Field(default=0, ge=0)
    """Images used."""
    rms_px: float = Field(default=0.0, ge=0)
    """Reprojection error over all points [px]."""
    focal_sd_percent: float = Field(default=0.0, ge=0)
    """Standard deviation of the worse focal length [%]."""
    centre_sd_px: float = Field(default=0.0, ge=0)
    """Standard deviation of the worse principal point coordinate [px]."""
    k1_sd: float = Field(default=0.0, ge=0)
    """Standard deviation of `k1`."""
    forced: bool = False
    """Stored although it is poor."""
    sheet_focal_mm: float = Field(default=0.0, ge=0)
    """Focal length by the lens's data sheet [mm]; 0 is unknown."""
    sheet_pixel_um: float = Field(default=0.0, ge=0)
    """Side of a pixel of the images by the sensor's data sheet [um]; 0 is unknown."""

    @field_validator("date", mode="before")
    @classmethod
    def _unquoted(cls, day: object) -> object:
        """Take a date of TOML, which `config.reader` hands on as an array of one text."""
        return day[0] if isinstance(day, list) and day else day


class Camera(Section):
    """One calibrated camera."""

    name: str = ""
    """What it is, in the user's words."""
    intrinsics: Intrinsics
    """Projection and lens."""
    mount: MountSection = MountSection()
    """How it sits on the vehicle."""
    calibration: CalibrationRecord = CalibrationRecord()
    """Where the figures come from."""


def _slip(k: Intrinsics) -> str:
    """What no lens has: slipped digits give poses that look right. Empty for a possible lens."""
    side = max(k.width, k.height)
    if not all(FOCAL_SIDES[0] * side <= focal <= FOCAL_SIDES[1] * side for focal in (k.fx, k.fy)):
        return f"no lens has a focal length of {k.fx:g}, {k.fy:g} px on {k.width}x{k.height}"
    if not 1 / MAX_ASPECT <= k.fx / k.fy <= MAX_ASPECT:
        return f"fx {k.fx:g} and fy {k.fy:g} differ too much for square pixels"
    if not (0.0 <= k.cx <= k.width and 0.0 <= k.cy <= k.height):
        return f"the centre {k.cx:g}, {k.cy:g} is outside the {k.width}x{k.height} image"
    return ""


def load_camera(path: Path) -> Camera:
    """Read a camera file, ours or the calibration of ROS or Kalibr.

    Raises:
        ConfigError: missing, unreadable, or a key or value is wrong; one line names file, place and fix.
    """
    try:
        camera = _of_others(path) or load_section(Camera, path)
    except ConfigError as error:
        msg = f"camera file {error}; make one with mkdaemon calibrate camera, every key is in docs/configuration.md"
        raise ConfigError(msg) from None
    slip = _slip(camera.intrinsics)
    if slip:
        msg = f"camera file {path}: intrinsics: {slip}; calibrate again, or correct what was typed"
        raise ConfigError(msg)
    return camera


def _of_others(path: Path) -> Camera | None:
    """A calibration of another program; None where the file is none.

    Raises:
        ConfigError: it cannot be read, or a figure is wrong.
    """
    text = read_file(path)
    try:
        found = figures_of(text)
        if found is None:
            return None
        return Camera(name=found.name, intrinsics=Intrinsics(**found.intrinsics))
    except ValidationError as error:
        first = error.errors()[0]
        msg = f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise ConfigError(msg) from error
    except ConfigError as error:
        msg = f"{path}: {error}"
        raise ConfigError(msg) from error


def save_camera(camera: Camera, path: Path, *, overwrite: bool = False) -> None:
    """Write a camera file, whole or not at all.

    Raises:
        ConfigError: the file is there already and `overwrite` is off, it is another program's, or no lens has such
            figures.
        MkError: the file cannot be written; what was there is untouched.
    """
    slip = _slip(camera.intrinsics)
    if slip:
        msg = f"camera file {path} not written: {slip}: take more views, turned to every side"
        raise ConfigError(msg)
    if overwrite and path.exists() and figures_of(read_file(path)) is not None:
        msg = f"{path} is the calibration of another program; first: mkdaemon calibrate import {path} camera.toml"
        raise ConfigError(msg)
    lines = [f"name = {toml_value(camera.name)}"]
    for title in ("intrinsics", "mount", "calibration"):
        lines += ["", f"[{title}]"]
        lines += [f"{key} = {toml_value(value)}" for key, value in getattr(camera, title) if value is not None]
    save(path, "\n".join(lines) + "\n", overwrite=overwrite)
