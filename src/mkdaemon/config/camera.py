"""Configuration of cameras: where images come from, how the camera sits on the vehicle, what is published."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from mkdaemon.config.base import Section
from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import read_text

CameraName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,31}$")]


SHORTEST_SECRET: Final = 16
"""Of images [characters]."""


def read_image_secret(path: Path) -> str:
    """Read the secret with which images are signed.

    Raises:
        ConfigError: the file cannot be read, or the secret is too short.
    """
    try:
        secret = read_text(path).strip()
    except (OSError, UnicodeDecodeError) as error:
        msg = f"secret_file {path}: {getattr(error, 'strerror', None) or 'not UTF-8 text'}"
        raise ConfigError(msg) from error
    if len(secret) < SHORTEST_SECRET:
        msg = f"secret_file {path}: {len(secret)} characters, {SHORTEST_SECRET} needed: `openssl rand -hex 16 > {path}`"
        raise ConfigError(msg)
    return secret


class MountSection(Section):
    """Mounting of a camera on the vehicle."""

    position_flu: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Optical centre in the body frame: forward, left, up [m].

    An error of 1 cm shifts every position by 1 cm."""
    looks: Literal["down", "forward", "back", "left", "right", "up"] = "down"
    """Direction of view before `rpy_deg`. Top of the image: to the nose for `down`, to the tail for `up`, else up.

    With a wrong value the aircraft flies the wrong way: tilt it by hand, and `mkctl preflight` finds the error."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Small turn from that direction about body forward, left, up, in the order yaw, pitch, roll [deg].

    An error of 1 degree shifts a position by 3.5 cm at 2 m."""


class CameraSection(Section):
    """One camera of the vehicle: `[[cameras]]`."""

    name: CameraName = "down"
    """Name on the bus, `vision/<name>/...`.

    Two cameras with the same name are refused."""
    source: str = Field(min_length=1)
    """`/dev/video0` or `v4l2:PATH`, `rtsp://...`, `gstreamer:PIPELINE`, `file:CLIP`, `folder:DIR`, `zenoh:KEY`.

    The daemon keeps trying to open a missing source, and refuses flights by the target."""
    secret_file: Path | None = None
    """File with the secret that the sender of a `zenoh:` source signs its images with, 16 characters or more; unset:
    images from any program are used.

    If unset, any program on the bus can steer the aircraft with its images."""
    calibration: Path | None = None
    """Camera file of `mkdaemon calibrate camera`; without one the daemon publishes tags, but no poses.

    With the file of another camera or focus, every height has the relative error of the focal length."""
    targets: tuple[Path, ...] = ()
    """Target files this camera looks for.

    A wrong size in the file gives every distance the same relative error."""
    mount: MountSection | None = None
    """Mounting on the vehicle; unset: the mount of the camera file.

    See its keys."""
    width: int | None = Field(default=None, gt=0, le=8192)
    """Width [px]; unset: the driver's choice.

    Wider shows smaller tags, but each image takes longer; an aspect ratio other than the calibration's is refused."""
    height: int | None = Field(default=None, gt=0, le=8192)
    """Height [px].

    See `width`."""
    fps: float | None = Field(default=None, gt=0, le=1000)
    """Image rate [Hz].

    Higher needs light and USB bandwidth; lower holds the position less accurately."""
    exposure_ms: Literal["auto", "target"] | Annotated[float, Field(gt=0, le=1000)] | None = None
    """Shutter time [ms]; `auto`: the camera chooses; `target`: the daemon chooses by the tags; unset: unchanged.

    Longer blurs in motion; shorter is dark."""
    exposure_longest_ms: float = Field(default=15.0, gt=0, le=1000)
    """Longest shutter time that `target` may choose [ms]; motion during it blurs.

    Longer blurs in motion; shorter is dark at dusk."""
    gain: float | None = Field(default=None, ge=0)
    """Gain in the driver's unit; unset: unchanged.

    Higher adds noise; lower is dark."""
    latency_ms: float = Field(default=0.0, ge=0, le=2000)
    """Delay from the middle of the exposure to the stamp, subtracted from every stamp [ms]; measure it once.

    An error of 20 ms weakens the control loop; `mkctl preflight` (time stamps) shows the error."""
    loop: bool = False
    """Repeat a file or folder.

    A flight jumps when its clip restarts."""
    paced: bool = True
    """Play a file or folder at its own rate; otherwise as fast as images are processed.

    Use false only for measurements."""
    silent_after: float = Field(default=1.0, gt=0, le=60)
    """Without an image for this long the camera counts as silent [s].

    Longer reports a dead camera later."""
    reopen_min: float = Field(default=0.2, gt=0, le=10)
    """First delay before a lost camera is reopened [s].

    Higher extends a short loss."""
    reopen_max: float = Field(default=5.0, gt=0, le=60)
    """Longest delay between two attempts, and longest wait for a network stream [s].

    Higher leaves a returned camera unused for longer."""
    jpeg_hz: float = Field(default=0.0, ge=0, le=60)
    """Largest rate of images on the bus; 0: none.

    Higher takes processor time and network from the flight."""
    jpeg_quality: int = Field(default=60, ge=1, le=100)
    """Quality of published images.

    Higher takes more network; the flight does not use these images."""
    jpeg_width: int = Field(default=640, gt=0, le=8192)
    """Published images are scaled down to this width [px].

    Wider takes more processor time and network."""

    def image_secret(self) -> str | None:
        """Read the secret; see `read_image_secret`."""
        return None if self.secret_file is None else read_image_secret(self.secret_file)

    @model_validator(mode="after")
    def _delays_in_order(self) -> Self:
        if self.reopen_min > self.reopen_max:
            msg = f"reopen_min {self.reopen_min:g} <= reopen_max {self.reopen_max:g} does not hold"
            raise ValueError(msg)
        return self
