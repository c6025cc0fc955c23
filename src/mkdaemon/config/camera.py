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

    Wrong by a centimetre is a centimetre in every position."""
    looks: Literal["down", "forward", "back", "left", "right", "up"] = "down"
    """Direction of view before `rpy_deg`. Top of the image: to the nose for `down`, to the tail for `up`, else up.

    The wrong one flies the wrong way: `mkctl preflight` finds it by a tilt in the hand."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Small turn from that direction about body forward, left, up, in the order yaw, pitch, roll [deg].

    Wrong by a degree is 3.5 cm at 2 m."""


class CameraSection(Section):
    """One camera of the vehicle: `[[cameras]]`."""

    name: CameraName = "down"
    """Name on the bus, `vision/<name>/...`.

    Two cameras of one name are refused."""
    source: str = Field(min_length=1)
    """`/dev/video0` or `v4l2:PATH`, `rtsp://...`, `gstreamer:PIPELINE`, `file:CLIP`, `folder:DIR`, `zenoh:KEY`.

    One that is not there is opened again and again, and no flight by the target begins."""
    secret_file: Path | None = None
    """File with the secret that the sender of a `zenoh:` source signs its images with, 16 characters or more; unset
    takes images from any program.

    Unset, any program on the bus can steer the aircraft with its images."""
    calibration: Path | None = None
    """Camera file of `mkdaemon calibrate camera`; without one tags are published, poses never.

    That of another camera or focus makes every height wrong by the share of the focal length."""
    targets: tuple[Path, ...] = ()
    """Target files this camera looks for.

    A size that is wrong in the file makes every distance wrong by the same share."""
    mount: MountSection | None = None
    """How it sits on the vehicle; unset takes the mount of the camera file.

    See its keys."""
    width: int | None = Field(default=None, gt=0, le=8192)
    """Wanted width [px]; unset leaves the driver's choice.

    Wider sees smaller tags and takes longer for each image; another shape than the calibration's is refused."""
    height: int | None = Field(default=None, gt=0, le=8192)
    """Wanted height [px].

    See `width`."""
    fps: float | None = Field(default=None, gt=0, le=1000)
    """Wanted rate [Hz].

    Higher needs light and a USB bus that carries it; lower holds less steadily."""
    exposure_ms: Literal["auto", "target"] | Annotated[float, Field(gt=0, le=1000)] | None = None
    """Shutter time [ms]; `auto` lets the camera choose, `target` us by what the tags need; unset leaves the driver.

    Longer blurs in motion; shorter is dark."""
    exposure_longest_ms: float = Field(default=15.0, gt=0, le=1000)
    """Longest shutter time that `target` may choose [ms]; motion during it blurs.

    Longer blurs in motion; shorter is dark at dusk."""
    gain: float | None = Field(default=None, ge=0)
    """Gain in the driver's own unit; unset leaves it.

    Higher adds noise; lower is dark."""
    latency_ms: float = Field(default=0.0, ge=0, le=2000)
    """From the middle of the exposure to the stamp, subtracted from every stamp [ms]; measure it once.

    Wrong by 20 ms weakens the loop; `mkctl preflight` (time stamps) shows how much it is."""
    loop: bool = False
    """Play a file or folder again and again.

    A flight by a clip that begins again jumps."""
    paced: bool = True
    """Play a file or folder at its own rate; otherwise as fast as images are taken.

    False is for measuring alone."""
    silent_after: float = Field(default=1.0, gt=0, le=60)
    """Without an image for this long the camera counts as silent [s].

    Longer says later that a camera has died."""
    reopen_min: float = Field(default=0.2, gt=0, le=10)
    """First delay before a lost camera is opened again [s].

    Higher makes a short loss longer."""
    reopen_max: float = Field(default=5.0, gt=0, le=60)
    """Longest delay between two attempts, and longest wait for a network stream [s].

    Higher leaves a camera that is back unused for longer."""
    jpeg_hz: float = Field(default=0.0, ge=0, le=60)
    """Images published on the bus a second, at most; 0 publishes none.

    Higher takes processor time and network from the flight."""
    jpeg_quality: int = Field(default=60, ge=1, le=100)
    """Quality of published images.

    Higher takes more network, and the flight does not see these images."""
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
