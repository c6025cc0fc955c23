"""Poses of the vehicle by a source outside: motion capture, or any other localisation."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from mkdaemon.telemetry.base import Command, Stamped

_Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
_Share = Annotated[float, Field(ge=-1.5, le=1.5)]


def report_key(name: str) -> str:
    """Key of the reports of a source, without `mk/<vehicle>/`."""
    return f"positions/{name}/report"


class PositionReport(Command):
    """Where a source of poses measured the vehicle: `positions/<name>/report`, newest wins.

    A source that does not see the body sends nothing: a pose is never sent twice.
    """

    epoch: int = Field(ge=0)
    """Number of the sender's start, larger with each: Unix time [ms]. The clock behind the signature is its own."""
    sequence: int = Field(ge=0)
    """Counts up from one report of an epoch to the next."""
    age: float = Field(ge=0.0, le=10.0)
    """From the moment that it shows to its sending [s], as far as the sender knows."""
    position: tuple[_Metres, _Metres, _Metres] = Field(strict=False)
    """Of the tracked body, in the frame of the source [m]."""
    quaternion: tuple[_Share, _Share, _Share, _Share] = Field(strict=False)
    """Attitude of the tracked body in the frame of the source (w, x, y, z)."""
    covariance: tuple[float, ...] | None = Field(default=None, min_length=36, max_length=36, strict=False)
    """`(6, 6)` by rows over position and rotation vector, in the source's axes [m2] [m rad] [rad2]; null: as
    configured."""

    @model_validator(mode="after")
    def _has_a_rotation(self) -> "PositionReport":
        if not 0.9 < math.hypot(*self.quaternion) < 1.1:
            msg = "quaternion: its length is not 1"
            raise ValueError(msg)
        return self


class PositionHealth(Stamped):
    """What the sender of a source says of itself: `positions/<name>/health`."""

    source: str
    """Name of the source."""
    system: str
    """Kind and address of what it reads."""
    body: str
    """Name of the tracked body there."""
    rate: float
    """Reports of the last second [Hz]."""
    frames: float
    """Measurements of the system in it, with this body or without [Hz]."""
    lost: int
    """Measurements without this body, since the start."""
    reconnections: int
    """How often the system had to be reached again."""
    seen: tuple[str, ...]
    """Bodies in the newest measurement."""
    reason: str
    """Why nothing is sent; empty while reports are sent."""
