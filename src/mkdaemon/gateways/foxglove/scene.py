"""The scene: target with its tags, vehicle, path, goal, fence, and the ellipsoid of what is not known of the place.

An entity is sent again when it changes, under the same name. What is new in the scene is decided here, by the stamps of
the values alone.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    Duration,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    SceneEntity,
    SceneEntityDeletion,
    SceneUpdate,
    SpherePrimitive,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)

from mkdaemon.client.place import AircraftPlace, Array
from mkdaemon.gateways.foxglove.names import Names, pose, timestamp, vector
from mkdaemon.gateways.foxglove.whereabouts import Whereabouts
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlError, ControlFence
from mkdaemon.telemetry.vision import CameraSetup, TagShape, TargetShape

BLACK: Final = Color(r=0.05, g=0.05, b=0.05, a=1.0)
WHITE: Final = Color(r=0.95, g=0.95, b=0.95, a=1.0)
GREY: Final = Color(r=0.35, g=0.38, b=0.42, a=1.0)
RED: Final = Color(r=0.85, g=0.15, b=0.1, a=1.0)
BLUE: Final = Color(r=0.2, g=0.55, b=1.0, a=1.0)
ORANGE: Final = Color(r=1.0, g=0.6, b=0.1, a=1.0)
FAINT: Final = Color(r=0.3, g=0.7, b=1.0, a=0.25)
FENCE: Final = Color(r=0.9, g=0.75, b=0.2, a=0.6)

ARM: Final = 0.25
"""From the middle of the vehicle to a motor, as it is drawn [m]."""
PATH: Final = 750
"""Points of the path: 150 s."""
PATH_STEP: Final = 0.2
"""Between two points of the path [s]."""
PATH_PERIOD: Final = 0.5
"""Between two times that the path is sent [s]."""
ELLIPSE_PERIOD: Final = 0.05
"""Between two ellipsoids [s]."""
GOAL_LIFE: Final = 1.0
"""A goal disappears this time after its last value [s]."""
LIFT: Final = 0.0005
"""Distance between two layers of print, so that they do not flicker [m]."""
CIRCLE: Final = 48
"""Corners of a circle."""


class VehicleScene:
    """What is in the scene of one vehicle."""

    def __init__(self, names: Names) -> None:
        """Know nothing yet.

        Args:
            names: of the frames.
        """
        self._names = names
        self._where = Whereabouts()
        self._targets: dict[str, TargetShape] = {}
        self._shown = ""
        self._is_drawn = False
        self._path: deque[Point3] = deque(maxlen=PATH)
        self._added = self._sent = self._spread = float("-inf")

    def __call__(self, suffix: str, value: Stamped) -> bytes | None:
        """What a value changes in the scene; None for nothing."""
        entities: list[SceneEntity] = []
        deletions: list[SceneEntityDeletion] = []
        match value:
            case CameraSetup():
                self._targets |= {target.name: target for target in value.targets}
                entities += self._target(value)
            case ControlError():
                entities.append(self._goal(value))
            case ControlFence():
                entities.append(self._fence(value))
            case _:
                before = self._where.place
                place = self._where.take(value)
                if place is not None:
                    if before is not None and before.frame != place.frame:
                        deletions = self._begin_anew(timestamp(value.stamp))
                    entities += self._vehicle(value, place)
        if not entities and not deletions:
            return None
        return SceneUpdate(deletions=deletions, entities=entities).encode()

    def _begin_anew(self, time: Timestamp) -> list[SceneEntityDeletion]:
        """Another target is followed, or none: what stood in the frame of the old one goes."""
        self._shown = ""
        self._path.clear()
        self._added = self._sent = self._spread = float("-inf")
        return [SceneEntityDeletion(timestamp=time, id=name) for name in ("target", "path", "ellipse", "goal")]

    def _entity(self, value: Stamped, name: str, frame: str, **parts: object) -> SceneEntity:
        return SceneEntity(timestamp=timestamp(value.stamp), frame_id=frame, id=name, frame_locked=True, **parts)  # type: ignore[arg-type]

    def _target(self, value: Stamped) -> list[SceneEntity]:
        """The target that is followed; the first one that is looked for while none is."""
        place = self._where.place
        name = next(iter(self._targets), "") if place is None else place.frame
        if name not in self._targets:
            return []
        self._shown = name
        tags = self._targets[name].tags
        layers = [layer for level, tag in enumerate(tags) for layer in print_of(tag, 2 * level * LIFT)]
        title = TextPrimitive(
            pose=pose((0.0, 0.0, 0.02), np.eye(3)), billboard=True, font_size=0.06, color=GREY, text=name
        )
        return [self._entity(value, "target", name, triangles=layers, texts=[title])]

    def _vehicle(self, value: Stamped, place: AircraftPlace) -> list[SceneEntity]:
        names, at = self._names, place.at
        entities = []
        if not self._is_drawn:
            self._is_drawn = True
            entities.append(self._entity(value, "vehicle", names.body, **vehicle()))
        if self._shown != place.frame:
            entities += self._target(value)
        if at - self._added >= PATH_STEP:
            self._added = at
            x, y, z = (float(part) for part in place.position)
            self._path.append(Point3(x=x, y=y, z=z))
        if at - self._sent >= PATH_PERIOD and len(self._path) > 1:
            self._sent = at
            line = LinePrimitive(points=list(self._path), thickness=2.0, scale_invariant=True, color=BLUE)
            entities.append(self._entity(value, "path", names.map, lines=[line]))
        if place.spread is not None and at - self._spread >= ELLIPSE_PERIOD:
            self._spread = at
            entities.append(
                self._entity(value, "ellipse", names.map, spheres=[ellipsoid(place.position, place.spread)])
            )
        return entities

    def _goal(self, value: ControlError) -> SceneEntity:
        """Where it is to be, and the way there."""
        goal = np.array(value.goal)
        here = goal + np.array(value.error_pad)
        ball = SpherePrimitive(pose=pose(goal, np.eye(3)), size=Vector3(x=0.1, y=0.1, z=0.1), color=ORANGE)
        way = LinePrimitive(points=[_point(here), _point(goal)], thickness=1.5, scale_invariant=True, color=ORANGE)
        life = Duration.from_secs(GOAL_LIFE)
        return self._entity(value, "goal", self._names.map, lifetime=life, spheres=[ball], lines=[way])

    def _fence(self, value: ControlFence) -> SceneEntity:
        """Where autonomous flight ends: a circle below, one above, and edges between them."""
        angles = np.linspace(0.0, 2 * math.pi, CIRCLE, endpoint=False)
        around = [(value.radius * math.cos(angle), value.radius * math.sin(angle)) for angle in angles]
        rings = [[Point3(x=x, y=y, z=level) for x, y in around] for level in (value.floor, value.height)]
        edges = [point for place in range(0, CIRCLE, CIRCLE // 4) for point in (rings[0][place], rings[1][place])]
        kinds = LinePrimitiveLineType
        lines = [
            LinePrimitive(type=kind, points=points, thickness=1.0, scale_invariant=True, color=FENCE)
            for kind, points in ((kinds.LineLoop, rings[0]), (kinds.LineLoop, rings[1]), (kinds.LineList, edges))
        ]
        return self._entity(value, "fence", self._names.map, lines=lines)


def vehicle() -> dict[str, object]:
    """A quadrocopter in its own frame; its front arm is red."""

    def box(place: tuple[float, float, float], size: tuple[float, float, float], color: Color) -> CubePrimitive:
        return CubePrimitive(pose=pose(place, np.eye(3)), size=vector(size), color=color)

    arms = [
        box((x / 2, y / 2, 0.0), (max(abs(x), 0.025), max(abs(y), 0.025), 0.02), RED if x > 0 else GREY)
        for x, y in _MOTORS
    ]
    whole, size = {"bottom_scale": 1.0, "top_scale": 1.0}, vector((0.22, 0.22, 0.01))
    places = [pose((x, y, 0.04), np.eye(3)) for x, y in _MOTORS]
    rotors = [CylinderPrimitive(pose=place, size=size, color=FAINT, **whole) for place in places]
    return {"cubes": [box((0.0, 0.0, 0.0), (0.12, 0.12, 0.05), GREY), *arms], "cylinders": rotors}


_MOTORS: Final = ((ARM, 0.0), (-ARM, 0.0), (0.0, ARM), (0.0, -ARM))


def print_of(tag: TagShape, height: float) -> list[TriangleListPrimitive]:
    """A printed tag: white paper with a border of one cell, and its black cells above it.

    Args:
        tag: corners and cells.
        height: of the paper above the plane of the target [m].
    """
    top_left, top_right, _, bottom_left = np.array(tag.corners)
    right, down = top_right - top_left, bottom_left - top_left
    count = len(tag.cells)

    def at(column: float, row: float, up: float) -> Array:
        place: Array = top_left + right * (column / count) + down * (row / count) + [0.0, 0.0, up]
        return place

    def square(column: float, row: float, size: float, up: float) -> list[Point3]:
        corners = [at(column + x, row + y, up) for x, y in ((0, 0), (0, size), (size, size), (size, 0))]
        return [_point(corners[place]) for place in (0, 1, 2, 0, 2, 3)]

    black = [
        point
        for row, cells in enumerate(tag.cells)
        for column, cell in enumerate(cells)
        if cell == "#"
        for point in square(column, row, 1.0, height + LIFT)
    ]
    paper = square(-1.0, -1.0, count + 2.0, height)
    return [TriangleListPrimitive(points=paper, color=WHITE), TriangleListPrimitive(points=black, color=BLACK)]


def ellipsoid(position: Array, spread: Array) -> SpherePrimitive:
    """An ellipsoid: the unit sphere, turned and stretched by `spread` (3, 3) [m]."""
    axes, radii, _ = np.linalg.svd(spread)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    return SpherePrimitive(pose=pose(position, axes), size=vector(2.0 * radii), color=FAINT)


def _point(place: Array) -> Point3:
    x, y, z = (float(part) for part in place)
    return Point3(x=x, y=y, z=z)
