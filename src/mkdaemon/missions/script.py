"""A flight as a TOML file: one `[[step]]` after the other, checked whole before anything flies."""

from __future__ import annotations

import difflib
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, ValidationError, model_validator

from mkdaemon.config.base import Section
from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import LONGEST_SETTINGS, parse_toml, read_text
from mkdaemon.missions.pathcsv import read_pieces
from mkdaemon.telemetry.path import PathPiece, PathPoint, PathUploadRequest

_Metres = Annotated[float, Field(ge=-100.0, le=100.0)]
_Speed = Annotated[float, Field(ge=-5.0, le=5.0)]
_Seconds = Annotated[float, Field(gt=0.0, le=600.0)]
_Degrees = Annotated[float, Field(ge=-180.0, le=180.0)]


class TakeOffStep(Section):
    """Take off and hold over the middle of the target."""

    do: Literal["take_off"]
    height: float = Field(ge=0.5, le=10.0)
    """Above the target [m]."""
    patience: _Seconds = 30.0
    """Longest time [s]."""


class HoldStep(Section):
    """Stay where the aircraft is."""

    do: Literal["hold"]
    seconds: _Seconds
    """How long [s]."""


class GotoStep(Section):
    """Fly to a position and go on when the aircraft is there."""

    do: Literal["goto"]
    position: tuple[_Metres, _Metres, _Metres]
    """[m]."""
    frame: Literal["pad", "body"] = "pad"
    """From the middle of the target, or from where the aircraft is."""
    yaw_deg: _Degrees | None = None
    """Heading from the first axis of the frame; unset keeps it [deg]."""
    patience: _Seconds = 30.0
    """Longest time [s]."""


class VelocityStep(Section):
    """Fly at a velocity."""

    do: Literal["velocity"]
    velocity: tuple[_Speed, _Speed, _Speed]
    """[m/s]."""
    frame: Literal["pad", "body"] = "pad"
    """Axes of the target, or forward and left."""
    seconds: _Seconds
    """How long [s]."""


class WaitStep(Section):
    """Hold until a value on the bus is as wanted, for example `state/battery`, `voltage`, `above = 14`."""

    do: Literal["wait"]
    key: str = Field(min_length=1)
    """Key without `mk/<vehicle>/`."""
    field: str = Field(min_length=1)
    """Field of its value."""
    above: float | None = None
    """Go on when the field is above this."""
    below: float | None = None
    """Go on when the field is below this."""
    equals: bool | str | None = None
    """Go on when the field is this."""
    patience: _Seconds = 30.0
    """Longest time; the flight ends after it [s]."""

    @model_validator(mode="after")
    def _has_one_condition(self) -> WaitStep:
        if sum(wanted is not None for wanted in (self.above, self.below, self.equals)) != 1:
            msg = "give one of above, below and equals"
            raise ValueError(msg)
        return self

    def holds(self, value: Any) -> bool:
        """Whether a value of the field is as wanted."""
        if self.equals is not None:
            return bool(value == self.equals)
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        return value > self.above if self.above is not None else value < (self.below or 0.0)


class LandStep(Section):
    """Land on the target; always the last step."""

    do: Literal["land"]
    yaw_deg: _Degrees | None = None
    """Heading on the way down; unset keeps it [deg]."""
    patience: _Seconds = 60.0
    """Longest time [s]."""


class PathStepPoint(Section):
    """A point of a path."""

    position: tuple[_Metres, _Metres, _Metres]
    """From the middle of the target [m]."""
    time: Annotated[float, Field(ge=0.02, le=600.0)] | None = None
    """From the point before [s]."""
    speed: Annotated[float, Field(ge=0.02, le=5.0)] | None = None
    """From the point before [m/s]."""
    stop: Annotated[float, Field(ge=0.0, le=600.0)] | None = None
    """Stop here for this time [s]; unset flies through."""
    yaw_deg: _Degrees | None = None
    """Heading from the first axis of the target; unset at all points keeps it [deg]."""


class PathStep(Section):
    """Fly along a path, and go on when the aircraft is at its end."""

    do: Literal["path"]
    points: tuple[PathStepPoint, ...] = ()
    """Points with times or speeds."""
    pieces: tuple[PathPiece, ...] = ()
    """Polynomials, in place of points."""
    file: str = ""
    """A CSV file of polynomials beside this one, in place of both; crazyswarm writes such files."""
    slower: float = Field(default=1.0, ge=0.1, le=10.0)
    """Factor on its times: 2 flies it at half the speed."""
    target: str = Field(default="", max_length=100)
    """In whose axes it lies; empty for the target in sight."""

    @property
    def request(self) -> PathUploadRequest:
        """What is uploaded.

        Raises:
            ValidationError: it is no path.
        """
        slower = self.slower
        points = tuple(
            PathPoint(
                position=point.position,
                time=None if point.time is None else point.time * slower,
                speed=None if point.speed is None else point.speed / slower,
                stop=point.stop,
                yaw=None if point.yaw_deg is None else math.radians(point.yaw_deg),
            )
            for point in self.points
        )
        return PathUploadRequest(points=points, pieces=tuple(_slowed(piece, slower) for piece in self.pieces))


def _slowed(piece: PathPiece, slower: float) -> PathPiece:
    """A polynomial that takes `slower` times longer."""
    axes = {
        name: tuple(value / slower**power for power, value in enumerate(getattr(piece, name)))
        for name in ("x", "y", "z", "yaw")
    }
    return PathPiece(duration=piece.duration * slower, **axes)


Step = TakeOffStep | HoldStep | GotoStep | VelocityStep | PathStep | WaitStep | LandStep
STEPS: Final[Mapping[str, type[Step]]] = {
    "take_off": TakeOffStep,
    "hold": HoldStep,
    "goto": GotoStep,
    "velocity": VelocityStep,
    "path": PathStep,
    "wait": WaitStep,
    "land": LandStep,
}
"""Every kind of step by its word."""


def read_script(path: Path) -> tuple[Step, ...]:
    """Read a script and check all of it.

    Raises:
        ConfigError: the file cannot be read, or names the step that is wrong, what is wrong, and what there is.
    """
    try:
        tree = parse_toml(read_text(path, limit=LONGEST_SETTINGS))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    found = tree.get("step")
    unknown = [key for key in tree if key != "step"]
    if unknown or not isinstance(found, list) or not found:
        raise ConfigError(f"{path}: a script is a list of [[step]]{', not ' + unknown[0] if unknown else ''}")
    steps = tuple(_read_step(path, number, fields) for number, fields in enumerate(found, 1))
    for number, step in enumerate(steps, 1):
        if isinstance(step, LandStep) and number < len(steps):
            raise ConfigError(f"{path}: step {number}: land must be the last step: the aircraft is released after it")
        is_flying = any(not isinstance(before, WaitStep) for before in steps[: number - 1])
        if isinstance(step, TakeOffStep) and is_flying:
            raise ConfigError(f"{path}: step {number}: take_off must be the first step that flies")
    return steps


def _read_step(path: Path, number: int, fields: Any) -> Step:
    word = fields.get("do") if isinstance(fields, dict) else None
    kind = STEPS.get(str(word))
    if kind is None:
        near = difflib.get_close_matches(str(word), STEPS, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}?" if near else f"there is {', '.join(STEPS)}"
        raise ConfigError(f"{path}: step {number}: no such step do = {word!r}; {hint}")
    if kind is PathStep and fields.get("file"):
        given = [name for name in ("points", "pieces") if fields.get(name)]
        if given:
            raise ConfigError(f"{path}: step {number} (path): it has a file and {given[0]}; keep one")
        fields = {**fields, "pieces": read_pieces(path.parent / str(fields["file"]))}
    try:
        step: Step = kind.model_validate_json(json.dumps(fields, default=str), strict=True)
        if isinstance(step, PathStep):
            _ = step.request
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) if isinstance(part, str) else str(part + 1) for part in first["loc"])
        known = [name for name in kind.model_fields if name != "do"]
        near = difflib.get_close_matches(place, known, n=1)
        hint = f"; did you mean {near[0]}?" if first["type"] == "extra_forbidden" and near else ""
        words = first["msg"].removeprefix("Value error, ")
        raise ConfigError(f"{path}: step {number} ({word}): {place + ': ' if place else ''}{words}{hint}") from error
    return step
