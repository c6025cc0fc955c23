"""Losses of a mission in a file format, found by reading back the written file."""

from __future__ import annotations

from typing import Any, Final

from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

_TOLERANCE: Final = {"latitude_deg": 1e-7, "longitude_deg": 1e-7, "altitude": 1e-3}
"""Largest difference that is rounding; a point on the wire counts 1e-7 deg and 0.1 m."""


def lost(mission: Mission, back: Mission) -> tuple[str, ...]:
    """Return what differs between a mission and its file, one entry a field; the order of points of interest may."""
    flown = [(number, point) for number, point in enumerate(mission.points, 1) if point.kind is not PointKind.POI]
    pairs = list(zip(flown, (point for point in back.points if point.kind is not PointKind.POI), strict=True))
    found: list[str] = []
    for name in MissionPoint.model_fields:
        numbers = [number for (number, point), other in pairs if _differs(name, mission, point, back, other)]
        if numbers:
            found.append(f"{name} of {_listed(numbers)}")
    kept = {_place(point) for point in back.points if point.kind is PointKind.POI}
    gone = [
        number
        for number, point in enumerate(mission.points, 1)
        if point.kind is PointKind.POI and _place(point) not in kept
    ]
    if gone:
        found.append(f"{_listed(gone)}, which no point looks at")
    return tuple(found)


def _differs(name: str, mission: Mission, point: MissionPoint, back: Mission, other: MissionPoint) -> bool:
    ours, theirs = _value(name, mission, point), _value(name, back, other)
    if name in _TOLERANCE:
        return bool(abs(ours - theirs) > _TOLERANCE[name])
    return bool(ours != theirs) and not (name == "name" and not ours)


def _value(name: str, mission: Mission, point: MissionPoint) -> Any:
    if name == "poi" and point.poi is not None:
        return _place(mission.points[point.poi - 1])
    return getattr(point, name)


def _place(point: MissionPoint) -> tuple[float, ...]:
    return round(point.latitude_deg, 6), round(point.longitude_deg, 6), round(point.altitude)


def _listed(numbers: list[int]) -> str:
    if len(numbers) == 1:
        return f"point {numbers[0]}"
    return f"points {', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"
