"""Configuration of sources of poses: motion capture, or any other localisation on the bus."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from mkdaemon.config.base import Section
from mkdaemon.config.camera import CameraName, read_image_secret
from mkdaemon.config.vision import Metres3, Name

Use = Literal["takeoff", "flight", "landing"]
Degrees3 = tuple[float, float, float]


class PositionPlace(Section):
    """A named place in the frame of a source's target; a flight names it as it names a target."""

    name: Name = "pad"
    """Name in results and on the bus; no target or other place has it.

    With the name of another place, flights go by both at once."""
    position: Metres3 = (0.0, 0.0, 0.0)
    """Origin of the place in the frame of `target` [m].

    An error moves the landing by as much."""
    yaw_deg: float = Field(default=0.0, ge=-360.0, le=360.0)
    """Turn of its axes about the up axis of `target` [deg].

    An error turns every direction that is given from this place."""


class PositionSource(Section):
    """A source of poses that a program puts to `positions/<name>/report`: `[[positions]]`. Used as a camera is."""

    name: CameraName = "mocap"
    """Name on the bus; no camera or other source has it.

    A name that a camera has is refused."""
    target: Name = "map"
    """Target or map in whose frame its poses count; a flight names it as a target.

    If a camera sees the same target, both are compared: use its name."""
    position: Metres3 = (0.0, 0.0, 0.0)
    """Origin of the source's frame in the frame of `target` [m].

    An error shifts every position by as much; with two sources they contradict each other."""
    rpy_deg: Degrees3 = (0.0, 0.0, 0.0)
    """Rotation of the source's frame in the frame of `target`: roll, pitch, yaw [deg]. (90, 0, 0) for axes with y up.

    With a wrong up, or mirrored axes, the boards contradict the source, and nothing is flown by it."""
    body_position: Metres3 = (0.0, 0.0, 0.0)
    """Origin of the tracked body in the body frame of the aircraft: forward, left, up [m].

    An error of 1 cm shifts every position by 1 cm."""
    body_rpy_deg: Degrees3 = (0.0, 0.0, 0.0)
    """Rotation of the tracked body in the body frame of the aircraft: roll, pitch, yaw [deg].

    With an error above 8 degrees the boards contradict the source."""
    position_sd: float = Field(default=0.002, gt=0, le=1.0)
    """Standard deviation of a position, for reports without a covariance [m].

    Smaller than the true one makes the aircraft follow the noise; larger holds the place less accurately."""
    angle_sd_deg: float = Field(default=0.5, gt=0, le=20.0)
    """Standard deviation of an angle, how the body was defined included [deg].

    Smaller than the true one lets a body that was defined crooked tilt the estimate."""
    frame_sd: float = Field(default=0.01, ge=0, le=1.0)
    """Standard deviation of `position`: what all its reports have in common [m].

    Smaller than the true one makes it contradict a camera that is right."""
    max_age: float = Field(default=0.15, gt=0, le=0.5)
    """Oldest pose that is taken [s], by the clock of its sender.

    Longer flies by late poses, which oscillates above 0.2 s; shorter loses poses on a network that stalls."""
    trusted_for: tuple[Use, ...] = ("takeoff", "flight", "landing")
    """What may be flown by this source alone; without `flight` it is only published, to compare cameras with.

    With too much, the aircraft lands by a source that is too inaccurate for it."""
    places: tuple[PositionPlace, ...] = ()
    """Named places in the frame of `target` to take off from, fly to and land on."""
    secret_file: Path | None = None
    """File with the secret that its sender signs with, 16 characters or more; unset: reports of any program are used.

    If unset, any program on the bus can steer the aircraft with its reports."""

    def secret(self) -> str | None:
        """Read the secret; see `read_image_secret`."""
        return None if self.secret_file is None else read_image_secret(self.secret_file)


Positions = Annotated[tuple[PositionSource, ...], Field(max_length=8)]
