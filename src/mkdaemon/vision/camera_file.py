"""The camera file: what a calibration found, and how the camera sits on the vehicle."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field, ValidationError

from mkdaemon.config.base import Section
from mkdaemon.config.camera import MountSection
from mkdaemon.errors import ConfigError
from mkdaemon.frames import FLU_FROM_RDF, rotation_from_euler
from mkdaemon.vision.intrinsics import Intrinsics

Array = npt.NDArray[np.float64]

_FLU_FROM_CAM: dict[str, Array] = {
    "forward": FLU_FROM_RDF,
    "back": rotation_from_euler(0.0, 0.0, math.pi) @ FLU_FROM_RDF,
    "left": rotation_from_euler(0.0, 0.0, math.pi / 2) @ FLU_FROM_RDF,
    "right": rotation_from_euler(0.0, 0.0, -math.pi / 2) @ FLU_FROM_RDF,
    "down": rotation_from_euler(0.0, math.pi / 2, 0.0) @ FLU_FROM_RDF,
    "up": rotation_from_euler(0.0, -math.pi / 2, 0.0) @ FLU_FROM_RDF,
}


def mount_rotation(mount: MountSection) -> Array:
    """Body from camera `(3, 3)`, FLU from RDF: the direction of view, turned by the small angles about body axes."""
    roll, pitch, yaw = (math.radians(angle) for angle in mount.rpy_deg)
    rotation: Array = rotation_from_euler(roll, pitch, yaw) @ _FLU_FROM_CAM[mount.looks]
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


def load_camera(path: Path) -> Camera:
    """Read a camera file.

    Raises:
        ConfigError: missing, unreadable, or a key or value is wrong; one line names file, place and fix.
    """
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
        return Camera.model_validate(content)
    except OSError as error:
        msg = f"camera file {path}: {error.strerror or error}; make one with mkctl calibrate camera"
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        msg = f"camera file {path}: not TOML ({error}); see configs/cameras"
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        msg = f"camera file {path}: {place}: {first['msg']}; see configs/cameras for every key"
    raise ConfigError(msg)


def save_camera(camera: Camera, path: Path) -> None:
    """Write a camera file.

    Raises:
        ConfigError: the place cannot be written.
    """
    lines = [f"name = {_toml(camera.name)}"]
    for title, section in (
        ("intrinsics", camera.intrinsics),
        ("mount", camera.mount),
        ("calibration", camera.calibration),
    ):
        lines += ["", f"[{title}]"]
        lines += [f"{key} = {_toml(value)}" for key, value in section]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        msg = f"camera file {path}: {error.strerror or error}"
        raise ConfigError(msg) from None


def _toml(value: object) -> str:
    """One TOML value; a JSON string is a TOML basic string."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(value)
