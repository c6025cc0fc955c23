"""Paths that were uploaded: checked against what the aircraft can do, and kept until the daemon ends."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass
from hashlib import blake2b
from typing import Final

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import GRAVITY, AircraftModel
from mkdaemon.control.linear import Array
from mkdaemon.control.path.curve import AXES, CurveMotion, PathCurve
from mkdaemon.telemetry.path import ID_LENGTH, PathStored, PathUploadRequest
from mkdaemon.telemetry.refusals import Token, refuse

KEPT: Final = 16
"""Paths that are kept; a path of 500 pieces has 130 kB."""
LOOKS: Final = np.linspace(0.0, 1.0, 17)
"""Places of a piece that are checked: polynomials of degree 7 hide little between them."""
DRAWN: Final = 100
"""Points of a path for drawing."""
TILTED: Final = 0.75
"""Share of `max_tilt` that a path may need: the rest is for the wind, and for the change of tilt."""
CLIMB_ACCELERATION: Final = 0.8
"""Largest vertical acceleration [m/s2]: that of the height's reference in all manoeuvres."""
TURN: Final = math.radians(10.0)
"""Largest turn rate [rad/s]: that of the largest yaw stick; `regulator/autopilot.py`."""
SMALLEST_SLOWING: Final = 1.05
"""Least factor that a remedy names: a smaller one would be refused for rounding."""
GAPS: Final = (("position", 0.02, "m"), ("velocity", 0.05, "m/s"), ("acceleration", 0.3, "m/s2"))
"""Largest step between two pieces; files of coefficients are rounded."""
REST: Final = 0.05
"""A path begins and ends at most this fast [m/s]."""


@dataclass(frozen=True, slots=True)
class StoredPath:
    """A path that the aircraft can fly.

    Attributes:
        curve: it.
        drawn: some of its points.
        answer: for who uploaded it.
    """

    curve: PathCurve
    drawn: tuple[tuple[float, float, float], ...]
    answer: PathStored


class StoredPaths:
    """The newest paths; the one that was used last is never dropped."""

    def __init__(self, cfg: AutopilotConfig) -> None:
        """Store none yet; `cfg` limits them."""
        self._cfg = cfg
        self._paths: OrderedDict[str, StoredPath] = OrderedDict()
        self._used = ""

    @property
    def ids(self) -> frozenset[str]:
        """Of all that are stored."""
        return frozenset(self._paths)

    def upload(self, request: PathUploadRequest, model: AircraftModel) -> PathStored:
        """Check a path, and store it.

        Args:
            request: points or pieces.
            model: of the aircraft that is to fly it.

        Raises:
            CommandRejectedError: `path_refused`: which piece asks for what, and when.
        """
        curve = PathCurve.of(request)
        looks = curve.pieces_at(LOOKS)
        _check_whole(curve, looks)
        _check_limits(curve, looks, self._cfg, model)
        # Of what was asked for, not of what was computed: a replay on another computer rounds otherwise.
        name = blake2b(request.model_dump_json().encode(), digest_size=ID_LENGTH // 2).hexdigest()
        known = self._paths.pop(name, None)
        found = self._paths[name] = known or _stored(name, request, curve, looks)
        if len(self._paths) > KEPT:
            del self._paths[next(each for each in self._paths if each != self._used)]
        return found.answer

    def use(self, path: str) -> None:
        """Take that a path, if stored, is asked for by an admitted setpoint: it is kept until another one is."""
        if path in self._paths:
            self._used = path

    def find(self, path: str) -> StoredPath:
        """The path of an id that is stored."""
        return self._paths[path]


def _stored(name: str, request: PathUploadRequest, curve: PathCurve, looks: CurveMotion) -> StoredPath:
    """Measure a path."""
    ways = np.diff(looks.position[:, :, :3], axis=1)
    drawn = curve.at(np.linspace(0.0, curve.duration, DRAWN)).position[:, :3]
    answer = PathStored(
        id=name,
        pieces=len(curve.durations),
        duration=curve.duration,
        length=float(np.linalg.norm(ways, axis=2).sum()),
        speed=float(_level(looks.velocity).max()),
        acceleration=float(_level(looks.acceleration).max()),
        climb=float(np.abs(looks.velocity[:, :, 2]).max()),
        times=_times(request, curve),
    )
    return StoredPath(curve, tuple((float(x), float(y), float(z)) for x, y, z in drawn.round(3)), answer)


def _times(request: PathUploadRequest, curve: PathCurve) -> tuple[float, ...]:
    """When each point is reached [s]: each way is a piece, and so is each stop."""
    times: list[float] = []
    piece, begins = 0, (*curve.starts.tolist(), curve.duration)
    for number, point in enumerate(request.points):
        piece += 1 if number else 0
        times.append(float(begins[piece]))
        piece += 1 if point.stop else 0
    return tuple(times)


def _level(vectors: Array) -> Array:
    """Horizontal size of vectors (n, k, 4)."""
    return np.hypot(vectors[:, :, 0], vectors[:, :, 1])


def _check_whole(curve: PathCurve, looks: CurveMotion) -> None:
    """Refuse a path that jumps, or that does not rest at its ends.

    Raises:
        CommandRejectedError: `path_refused`.
    """
    for (name, largest, unit), values in zip(GAPS, (looks.position, looks.velocity, looks.acceleration), strict=True):
        axes = slice(0, AXES if curve.turns else 3)
        steps = np.linalg.norm(values[1:, 0, axes] - values[:-1, -1, axes], axis=1)
        if steps.size and steps.max() > largest:
            piece = int(np.argmax(steps > largest)) + 1
            detail = f"{_place(curve, piece, 0.0)} begins with a step of {steps[piece - 1]:.2g} {unit} in its {name}"
            raise refuse(Token.PATH_REFUSED, detail=detail, remedy="Begin each piece as the one before ends.")
    for piece, look, word in ((0, 0, "begins"), (len(curve.durations) - 1, -1, "ends")):
        speed = float(np.linalg.norm(looks.velocity[piece, look, :3]))
        if speed > REST:
            detail = f"{_place(curve, piece, LOOKS[look])} {word} at {speed:.2g} m/s, not at rest"
            remedy = "Begin with a piece that speeds up from rest, and end with one that slows down."
            raise refuse(Token.PATH_REFUSED, detail=detail, remedy=remedy)


def _check_limits(curve: PathCurve, looks: CurveMotion, cfg: AutopilotConfig, model: AircraftModel) -> None:
    """Refuse a path that asks for more than the aircraft can do, or leaves the fence.

    Raises:
        CommandRejectedError: `path_refused`.
    """
    place, option = looks.position, "control.autopilot."
    radius, height = _level(place), place[:, :, 2]
    for found, limit, name, words in (
        (radius, cfg.fence_radius, "fence_radius", "is {found:.2f} m from the middle, farther than {limit:g} m"),
        (height, cfg.fence_height, "fence_height", "is {found:.2f} m high, above {limit:g} m"),
        (-height, -cfg.fence_floor, "fence_floor", "is {found:.2f} m high, below {limit:g} m"),
    ):
        if found.max() > limit + 1e-6:
            where, worst = _worst(curve, found)
            detail = f"{where} {words.format(found=abs(worst), limit=abs(limit))}, which is {option}{name}"
            raise refuse(Token.PATH_REFUSED, detail=detail, remedy=f"Move it inside, or change {option}{name}.")
    drag = np.abs(looks.acceleration + model.drag * looks.velocity)
    tilt, turn = _level(drag) / GRAVITY, np.abs(looks.velocity[:, :, 3])
    rise, jerk = np.abs(looks.velocity[:, :, 2]), np.abs(looks.acceleration[:, :, 2])
    asked = (
        (_level(looks.velocity), cfg.max_speed, 1.0, "m/s", f"{option}max_speed"),
        (_level(looks.acceleration), cfg.max_acceleration, 0.5, "m/s2", f"{option}max_acceleration"),
        (tilt, TILTED * cfg.max_tilt, 1.0, "rad of tilt", f"{TILTED:.0%} of {option}max_tilt"),
        (rise, cfg.max_climb, 1.0, "m/s up or down", f"{option}max_climb"),
        (jerk, CLIMB_ACCELERATION, 0.5, "m/s2 up or down", "the limit of every flight"),
        (turn, TURN, 1.0, "rad/s of turn", "the limit of every flight"),
    )
    slowing = max((float(found.max()) / limit) ** power for found, limit, power, _, _ in asked)
    for found, limit, _, unit, name in asked:
        if found.max() > limit * (1.0 + 1e-6):
            where, worst = _worst(curve, found)
            detail = f"{where} asks for {worst:.2f} {unit}; {name} is {limit:.2f}"
            factor = math.ceil(100.0 * max(slowing, SMALLEST_SLOWING)) / 100.0
            remedy = f"Slow the path down by {factor:.2f}: multiply its times, or divide its speeds."
            raise refuse(Token.PATH_REFUSED, detail=detail, remedy=remedy)


def _worst(curve: PathCurve, found: Array) -> tuple[str, float]:
    """Where the largest of (n, k) values is, in words, and the value."""
    piece, look = np.unravel_index(int(found.argmax()), found.shape)
    return _place(curve, int(piece), float(LOOKS[look])), float(found.max())


def _place(curve: PathCurve, piece: int, share: float) -> str:
    """A place of a path in words."""
    at = curve.starts[piece] + share * curve.durations[piece]
    return f"piece {piece + 1} of {len(curve.durations)}, at {at:.1f} s,"
