"""QGroundControl plans (`.plan`): JSON with one MAVLink command for each mission item.

Commands a MikroKopter point can express are read: waypoint, timed loiter, land, speed, region of interest, camera tilt
and camera distance. Any other is refused by name, because dropping it would fly another mission.
Sources: QGroundControl developer guide, "Plan file format"; MAVLink common message set, `MAV_CMD`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from mkdaemon.errors import ConfigError
from mkdaemon.missions.source import AltitudeReference, MissionDraft, Place, assemble, require_few
from mkdaemon.reading import parse_json
from mkdaemon.telemetry.mission import AUTOMATIC_CAMERA, Mission, MissionPoint, PointKind

_WAYPOINT, _LOITER_TIME, _LAND = 16, 19, 21
_CHANGE_SPEED, _ROI_LOCATION, _ROI_NONE, _ROI = 178, 195, 197, 201
_MOUNT_CONTROL, _CAMERA_DISTANCE = 205, 206
_NAMES = {17: "loiter", 18: "loiter turns", 20: "return to launch", 22: "take-off", 93: "delay", 177: "jump"}
COMMANDS = frozenset(
    {
        *(_WAYPOINT, _LOITER_TIME, _LAND, _CHANGE_SPEED, _ROI_LOCATION, _ROI_NONE, _ROI),
        *(_MOUNT_CONTROL, _CAMERA_DISTANCE),
    }
)
"""Commands that are read."""
_FRAMES = {0: AltitudeReference.SEA_LEVEL, 3: AltitudeReference.START}
_RELATIVE_FRAME, _NO_FRAME = 3, 2
_SAME_SPEED, _DEFAULT_SPEED = -1, -2
"""Speeds of `MAV_CMD_DO_CHANGE_SPEED` that mean "no change" and "the vehicle's own" (0 in a point)."""
_ITEMS = re.compile(r'"items"\s*:\s*\[')


@dataclass(slots=True)
class _Reading:
    """What earlier items have set for the points that follow."""

    points: list[MissionPoint] = field(default_factory=list)
    references: set[AltitudeReference] = field(default_factory=set)
    speed: float = 0.0
    poi: int | None = None
    camera_angle_deg: int = 0
    photo_distance: int = 0


def read(text: str, name: str) -> MissionDraft:
    """Read a plan.

    Raises:
        ConfigError: no plan, an item a MikroKopter cannot fly, or a wrong value; names file, line and fix.
    """
    try:
        plan = parse_json(text)
    except json.JSONDecodeError as error:
        msg = f"{name}:{error.lineno}: no JSON ({error.msg}); save the plan again"
        raise ConfigError(msg) from error
    if not isinstance(plan, dict) or plan.get("fileType") != "Plan":
        raise Place(name, 1).wrong('"fileType" is not "Plan"', "save the mission in QGroundControl as a .plan file")
    mission = plan.get("mission")
    items = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(items, list):
        raise Place(name, 1).wrong("the plan holds no mission", "add waypoints and save it again")
    require_few(name, len(items))
    return draft_of(items, (Place(name, line) for line in _lines(text, len(items))))


def draft_of(items: Sequence[Any], places: Iterable[Place]) -> MissionDraft:
    """Read mission items, each a map as a plan has it.

    Args:
        items: `type`, `command`, `frame` and seven `params`, of which None is one that is not given.
        places: of the items, for messages.

    Raises:
        ConfigError: no item, one that a MikroKopter cannot fly, or a wrong value; names its place and the fix.
    """
    reading = _Reading()
    first = Place("mission", 1)
    for number, (place, item) in enumerate(zip(places, items, strict=True)):
        first = place if number == 0 else first
        _take(place, item, reading)
    if len(reading.references) > 1:
        raise first.wrong("altitudes are partly relative, partly above sea level", "choose relative for all")
    return MissionDraft(assemble(first.name, reading.points), *reading.references)


def write(mission: Mission) -> str:
    """Return the mission as a plan; events, names and rates of climb, which plans cannot express, are left out.

    Raises:
        ConfigError: a fail-safe point, which a plan would fly to.
    """
    items = [item for item, _ in items_of(mission)]
    first = mission.points[0]
    plan = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "mkdaemon",
        "geoFence": {"version": 2, "circles": [], "polygons": []},
        "rallyPoints": {"version": 2, "points": []},
        "mission": {
            "version": 2,
            "firmwareType": 0,
            "vehicleType": 2,
            "cruiseSpeed": 5,
            "hoverSpeed": 5,
            "plannedHomePosition": [first.latitude_deg, first.longitude_deg, 0],
            "items": items,
        },
    }
    return json.dumps(plan, indent=2) + "\n"


def items_of(mission: Mission) -> list[tuple[dict[str, Any], int | None]]:
    """The mission as items of a plan, each with the number of the point that it flies to, from 1; None for none.

    Args:
        mission: the points.

    Raises:
        ConfigError: a fail-safe point, which a plan would fly to.
    """
    items: list[dict[str, Any]] = []
    flown: dict[int, int] = {}
    speed, poi, photo, tilt = 0.0, None, 0, 0
    for number, point in enumerate(mission.points, 1):
        if point.kind is PointKind.POI:
            continue
        if point.kind is PointKind.FAILSAFE:
            msg = f"point {number} is a fail-safe point, which a plan would fly to; choose .gpx, .kml, .csv or .wpl"
            raise ConfigError(msg)
        if point.speed != speed:
            items.append(_item(items, _CHANGE_SPEED, [1, point.speed or _DEFAULT_SPEED, -1, 0, 0, 0, 0], _NO_FRAME))
        if point.poi != poi:
            items.append(_roi(items, mission.points[point.poi - 1] if point.poi else None))
        if point.photo_distance != photo:
            items.append(_item(items, _CAMERA_DISTANCE, [point.photo_distance, 0, 0, 0, 0, 0, 0], _NO_FRAME))
        if point.camera_angle_deg not in (tilt, AUTOMATIC_CAMERA):
            items.append(_item(items, _MOUNT_CONTROL, [-point.camera_angle_deg, 0, 0, 0, 0, 0, 2], _NO_FRAME))
        speed, poi, photo, tilt = point.speed, point.poi, point.photo_distance, point.camera_angle_deg
        place = [point.latitude_deg, point.longitude_deg, point.altitude]
        flown[len(items)] = number
        if point.kind is PointKind.LAND:
            items.append(_item(items, _LAND, [0, 0, 0, point.heading_deg, *place], _RELATIVE_FRAME))
        else:
            values = [point.hold, point.radius, 0, point.heading_deg, *place]
            items.append(_item(items, _WAYPOINT, values, _RELATIVE_FRAME))
    return [(item, flown.get(index)) for index, item in enumerate(items)]


def _item(items: list[dict[str, Any]], command: int, params: list[Any], frame: int) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "command": command,
        "frame": frame,
        "params": params,
        "autoContinue": True,
        "doJumpId": len(items) + 1,
    }


def _roi(items: list[dict[str, Any]], poi: MissionPoint | None) -> dict[str, Any]:
    if poi is None:
        return _item(items, _ROI_NONE, [0, 0, 0, 0, 0, 0, 0], _NO_FRAME)
    place = [poi.latitude_deg, poi.longitude_deg, poi.altitude]
    return _item(items, _ROI_LOCATION, [0, 0, 0, 0, *place], _RELATIVE_FRAME)


def _lines(text: str, count: int) -> list[int]:
    """Line on which each of the `count` mission items begins; line 1 where that cannot be told."""
    start = next((m.end() for m in _ITEMS.finditer(text, text.find('"mission"'))), None)
    lines: list[int] = []
    decoder = json.JSONDecoder()
    while start is not None and len(lines) < count:
        while text[start] in " \t\r\n,":
            start += 1
        lines.append(text.count("\n", 0, start) + 1)
        start = decoder.raw_decode(text, start)[1]
    return lines or [1] * count


def _take(place: Place, item: Any, reading: _Reading) -> None:
    """Add one mission item to what has been read."""
    if not isinstance(item, dict) or item.get("type") != "SimpleItem":
        kind = item.get("complexItemType", "complex item") if isinstance(item, dict) else "no object"
        raise place.wrong(f"a {kind} cannot be flown as it is", "replace it by waypoints in QGroundControl")
    params = item.get("params")
    if not isinstance(params, list) or len(params) != 7:
        raise place.wrong("an item needs 7 params", "save the plan again")
    command = item.get("command")
    if command in (_WAYPOINT, _LOITER_TIME, _LAND):
        _take_point(place, item, command, params, reading)
    elif command == _CHANGE_SPEED:
        speed = _value(place, "speed", params[1])
        reading.speed = reading.speed if speed == _SAME_SPEED else max(speed, 0.0)
    elif command in (_ROI_LOCATION, _ROI):
        reading.points.append(_position(place, item, params, reading, kind=PointKind.POI))
        reading.poi = len(reading.points)
    elif command == _ROI_NONE:
        reading.poi = None
    elif command == _MOUNT_CONTROL:
        reading.camera_angle_deg = round(abs(_value(place, "camera pitch", params[0])))
    elif command == _CAMERA_DISTANCE:
        reading.photo_distance = round(_value(place, "camera distance", params[0]))
    else:
        known = _NAMES.get(command, "") if isinstance(command, int) else ""
        raise place.wrong(
            f"MikroKopter points cannot express command {command}{f' ({known})' if known else ''}",
            "remove the item: take-off, return and landing are flown by the pilot or mkctl",
        )


def _take_point(place: Place, item: dict[str, Any], command: int, params: list[Any], reading: _Reading) -> None:
    heading = params[3]
    fields: dict[str, Any] = {
        "kind": PointKind.LAND if command == _LAND else PointKind.WAYPOINT,
        "speed": reading.speed,
        "poi": reading.poi,
        "camera_angle_deg": reading.camera_angle_deg,
        "photo_distance": reading.photo_distance,
    }
    if command != _LAND:
        fields["hold"] = round(_value(place, "hold time", params[0] or 0))
    if command == _WAYPOINT and params[1]:
        fields["radius"] = round(_value(place, "acceptance radius", params[1]))
    if heading is not None and reading.poi is None:
        # A plan's 0 is north, but a MikroKopter's 0 keeps the heading: north is 360 there.
        fields["heading_deg"] = round(_value(place, "yaw", heading)) % 360 or 360
    reading.points.append(_position(place, item, params, reading, **fields))


def _position(place: Place, item: dict[str, Any], params: list[Any], reading: _Reading, **fields: Any) -> MissionPoint:
    frame = item.get("frame")
    if frame not in _FRAMES:
        raise place.wrong(f"altitude frame {frame} is not supported", "set the altitude mode to relative")
    reading.references.add(_FRAMES[frame])
    return place.point(
        latitude_deg=_value(place, "latitude", params[4]),
        longitude_deg=_value(place, "longitude", params[5]),
        altitude=_value(place, "altitude", params[6]),
        **fields,
    )


def _value(place: Place, word: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise place.wrong(f"{word} is {value!r}, no number", "save the plan again")
    return float(value)
