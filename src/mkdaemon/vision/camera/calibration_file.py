"""The camera file: what a calibration found, and how the camera sits on the vehicle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pydantic import Field, field_validator

from mkdaemon.config.base import Section
from mkdaemon.config.camera import MountSection
from mkdaemon.config.keys import toml_value
from mkdaemon.config.reader import load_section
from mkdaemon.errors import ConfigError
from mkdaemon.files import save
from mkdaemon.frames import FLU_FROM_RDF, rotation_from_euler
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.camera.intrinsics import Intrinsics

FOCAL_SIDES = (0.15, 60.0)
"""Focal lengths there are, in longer sides of the image: from a fish-eye to a telescope."""
MAX_ASPECT = 2.0
"""Ratio of the focal lengths; two with every other line left out."""

_LOOKS_DEG = {"forward": (0, 0), "back": (0, 180), "left": (0, 90), "right": (0, -90), "down": (90, 0), "up": (-90, 0)}
"""Pitch and yaw that turn a camera that looks forward [deg]."""


def mount_rotation(mount: MountSection) -> Array:
    """Body from camera `(3, 3)`, FLU from RDF: the direction of view, turned by the small angles about body axes."""
    small, looks = (
        rotation_from_euler(*map(math.radians, rpy)) for rpy in (mount.rpy_deg, (0, *_LOOKS_DEG[mount.looks]))
    )
    rotation: Array = small @ looks @ FLU_FROM_RDF
    return np.round(rotation, 15) + 0.0


class CalibrationRecord(Section):
    """Where the intrinsics come from and how good they are."""

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
    """Read a camera file.

    Raises:
        ConfigError: missing, unreadable, or a key or value is wrong; one line names file, place and fix.
    """
    try:
        camera = load_section(Camera, path)
    except ConfigError as error:
        msg = f"camera file {error}; make one with mkdaemon calibrate camera, every key is in docs/configuration.md"
        raise ConfigError(msg) from None
    slip = _slip(camera.intrinsics)
    if slip:
        msg = f"camera file {path}: intrinsics: {slip}; calibrate again, or correct what was typed"
        raise ConfigError(msg)
    return camera


def save_camera(camera: Camera, path: Path, *, overwrite: bool = False) -> None:
    """Write a camera file, whole or not at all.

    Raises:
        ConfigError: the file is there already and `overwrite` is off, or no lens has such figures.
        MkError: the file cannot be written; what was there is untouched.
    """
    slip = _slip(camera.intrinsics)
    if slip:
        msg = f"camera file {path} not written: {slip}: take more views, turned to every side"
        raise ConfigError(msg)
    lines = [f"name = {toml_value(camera.name)}"]
    for title in ("intrinsics", "mount", "calibration"):
        lines += ["", f"[{title}]"]
        lines += [f"{key} = {toml_value(value)}" for key, value in getattr(camera, title) if value is not None]
    save(path, "\n".join(lines) + "\n", overwrite=overwrite)
