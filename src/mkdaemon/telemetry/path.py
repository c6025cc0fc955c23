"""A path that is uploaded once and then flown: by points, or by polynomials; and how far a flight along it is."""

from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from mkdaemon.telemetry.base import Command, Stamped, Telemetry

MOST_PIECES: Final = 500
"""Most points, or polynomials, of a path."""
COEFFICIENTS: Final = 8
"""Of a polynomial, from the constant on: degree 7."""
ID_LENGTH: Final = 16
"""Of a path's id [characters]."""

_Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
_Angle = Annotated[float, Field(ge=-10.0, le=10.0)]
_Seconds = Annotated[float, Field(ge=0.02, le=600.0)]
_Coefficients = Annotated[tuple[float, ...], Field(min_length=1, max_length=COEFFICIENTS, strict=False)]


class PathPoint(Command):
    """A point of a path."""

    position: tuple[_Metres, _Metres, _Metres] = Field(strict=False)
    """In the axes of the target, from its middle [m]."""
    time: _Seconds | None = None
    """From the point before to this one [s]; give this or `speed`, the first point needs neither."""
    speed: Annotated[float, Field(ge=0.02, le=5.0)] | None = None
    """From the point before, as if along the straight line between them [m/s]: a mean, from which the curve differs at
    corners and next to a stop. The ways from a stop and to a stop take longer, to speed up and to slow down."""
    stop: Annotated[float, Field(ge=0.0, le=600.0)] | None = None
    """Stop here for this time [s]; null to fly through. The aircraft always stops at the first and the last point."""
    yaw: _Angle | None = None
    """Heading, counter-clockwise from the first axis of the target [rad]; null at all points keeps the heading."""


class PathPiece(Command):
    """One piece of a path: polynomials in the time since the piece began, from the constant coefficient on."""

    duration: _Seconds
    """[s]."""
    x: _Coefficients
    """Along the first axis of the target [m, m/s, m/s2 ...]."""
    y: _Coefficients
    """Along the second [m, m/s, m/s2 ...]."""
    z: _Coefficients
    """Up [m, m/s, m/s2 ...]."""
    yaw: Annotated[tuple[float, ...], Field(max_length=COEFFICIENTS, strict=False)] = ()
    """Heading, counter-clockwise from the first axis of the target [rad, rad/s ...]; empty in all pieces keeps it."""


class PathUploadRequest(Command):
    """Store a path: `do/path_upload`. It is checked, and can be flown by `setpoint/path` until the daemon restarts."""

    points: tuple[PathPoint, ...] = Field(default=(), max_length=MOST_PIECES, strict=False)
    """Flown through smoothly: at least two."""
    pieces: tuple[PathPiece, ...] = Field(default=(), max_length=MOST_PIECES, strict=False)
    """In place of points: each begins where the one before ends, at the same velocity and acceleration."""

    @model_validator(mode="after")
    def _has_one_form(self) -> Self:
        if bool(self.points) == bool(self.pieces):
            msg = "give points or pieces"
            raise ValueError(msg)
        if len(self.points) == 1:
            msg = "give at least two points"
            raise ValueError(msg)
        for number, point in enumerate(self.points[1:], 2):
            if (point.time is None) == (point.speed is None):
                msg = f"point {number}: give time or speed"
                raise ValueError(msg)
        return self


class PathStored(Telemetry):
    """A path that was stored, and what it asks for at most: the answer to `do/path_upload`."""

    id: str
    """For `setpoint/path`; the same path has the same id."""
    pieces: int
    """Number of its polynomials."""
    duration: float
    """Of a flight along it, without the way to its first point [s]."""
    length: float
    """[m]."""
    speed: float
    """Largest horizontal speed [m/s]."""
    acceleration: float
    """Largest horizontal acceleration [m/s2]."""
    climb: float
    """Largest vertical speed [m/s]."""
    times: tuple[float, ...] = ()
    """When each of its points is reached, from its beginning [s]; empty for a path of pieces."""


class PathProgress(Telemetry):
    """A path that is flown, and how far the flight is."""

    id: str
    """Of the path."""
    target: str
    """In whose axes it lies."""
    stage: str
    """Where the flight stands, in words."""
    is_paused: bool
    """Its holder has paused it."""
    progress: float
    """Share of its duration, 0 to 1."""
    left: float
    """Time until its end at full speed [s]."""
    rate: float
    """Speed along the path as a share of the planned one: below 1 where it begins, pauses, or waits for the
    aircraft."""
    points: tuple[tuple[float, float, float], ...]
    """The whole path for drawing, at equal times, from the middle of the target [m]."""


class PathFlown(Stamped, PathProgress):
    """The path that is flown: `control/path`."""
