"""QGroundControl plans (`.plan`): JSON with one MAVLink command for each mission item.

What a MikroKopter point can express is read (`missions.items` has the table), anything else is refused by name,
because dropping it would fly another mission.
Sources: QGroundControl developer guide, "Plan file format"; MAVLink common message set, `MAV_CMD`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import parse_json
from mkdaemon.missions import items as table
from mkdaemon.missions.items import (
    ARDUPILOT,
    CAMERA_DISTANCE,
    CHANGE_SPEED,
    FRAMES,
    GENERIC,
    LAND,
    MOUNT_CONTROL,
    NO_FRAME,
    RELATIVE_FRAME,
    ROI_LOCATION,
    ROI_NONE,
    WAYPOINT,
    Item,
    checked,
)
from mkdaemon.missions.source import AltitudeReference, FilePlace, MissionDraft, assemble, require_few
from mkdaemon.telemetry.mission import AUTOMATIC_CAMERA, Mission, MissionPoint, PointKind

_SAME_SPEED, _DEFAULT_SPEED = -1, -2
"""Speeds of `MAV_CMD_DO_CHANGE_SPEED` that mean "no change" and "the vehicle's own" (0 in a point)."""
_AIRSPEED, _GROUND_SPEED, _CLIMB_SPEED, _DESCENT_SPEED = 0, 1, 2, 3
_ROI_MODE_NONE, _ROI_MODE_LOCATION = 0, 3
_CLIMB = MissionPoint.model_fields["climb"].default
_SLOWEST = 0.1
"""Slowest speed that a point on the wire has [m/s]; 0 there means the fastest."""
_ITEMS = re.compile(r'"items"\s*:\s*\[')


@dataclass(slots=True)
class _Reading:
    """What earlier items have set for the points that follow."""

    autopilot: int
    points: list[MissionPoint] = field(default_factory=list)
    origins: list[int] = field(default_factory=list)
    references: set[AltitudeReference] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    speed: float = 0.0
    climb: float = _CLIMB
    descent: float = _CLIMB
    poi: int | None = None
    camera_angle_deg: int = 0
    photo_distance: int = 0
    is_returning: bool = False

    def climb_to(self, altitude: float) -> float:
        """Rate of climb or descent towards a height, from the point before; the first point lies above the start."""
        before = next((point.altitude for point in reversed(self.points) if point.kind is not PointKind.POI), 0.0)
        return self.descent if altitude < before else self.climb


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
        raise FilePlace(name, 1).wrong('"fileType" is not "Plan"', "save the mission in QGroundControl as a .plan file")
    mission = plan.get("mission")
    items = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(items, list):
        raise FilePlace(name, 1).wrong("the plan holds no mission", "add waypoints and save it again")
    require_few(name, len(items))
    firmware = mission.get("firmwareType") if isinstance(mission, dict) else None
    autopilot = firmware if isinstance(firmware, int) else GENERIC
    places = [FilePlace(name, line) for line in _lines(text, len(items))]
    draft = draft_of(items, places, autopilot)
    return replace(draft, notes=(*_beside(plan), *_waits(places, items, autopilot), *draft.notes))


def _waits(places: Sequence[FilePlace], items: Sequence[Any], autopilot: int) -> Iterator[str]:
    """The first point at which a plan for ArduPilot is to wait; for other autopilots such a plan is refused."""
    if autopilot == ARDUPILOT:
        waiting = (place for place, item in zip(places, items, strict=True) if _is_waiting(item))
        yield from (f"{place}: autoContinue is false, and ArduPilot goes on all the same" for place in [*waiting][:1])


def _is_waiting(item: Mapping[str, Any]) -> bool:
    return item.get("autoContinue", True) in (False, 0)


def _beside(plan: dict[str, Any]) -> Iterator[str]:
    """What a plan holds beside its mission."""
    for key, lists, what in (
        ("geoFence", ("circles", "polygons"), "geofence"),
        ("rallyPoints", ("points",), "rally points"),
    ):
        held = plan.get(key)
        if isinstance(held, dict) and any(held.get(name) for name in lists):
            yield f"the {what} of the plan: a NaviCtrl has none"


def draft_of(items: Sequence[Any], places: Iterable[FilePlace], autopilot: int = GENERIC) -> MissionDraft:
    """Read mission items, each a map as a plan has it.

    Args:
        items: `type`, `command`, `frame`, seven `params`, of which None is one that is not given, and `autoContinue`.
        places: of the items, for messages.
        autopilot: of `MAV_AUTOPILOT`: whose reading of the items counts.

    Raises:
        ConfigError: no item, one that a MikroKopter cannot fly, or a wrong value; names its place and the fix.
    """
    reading = _Reading(autopilot)
    first = FilePlace("mission", 1)
    for number, (place, item) in enumerate(zip(places, items, strict=True)):
        first = place if number == 0 else first
        _take(place, item, reading)
        reading.origins += [number] * (len(reading.points) - len(reading.origins))
    if len(reading.references) > 1:
        raise first.wrong("altitudes are partly relative, partly above sea level", "choose relative for all")
    mission = assemble(first.name, reading.points)
    reference = next(iter(reading.references))
    return MissionDraft(mission, reference, tuple(reading.notes), tuple(reading.origins))


def write(mission: Mission) -> str:
    """Return the mission as a plan; events and names, which plans cannot express, are left out.

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
    speed, poi, photo, tilt, height = 0.0, None, 0, 0, 0.0
    climbs = {_CLIMB_SPEED: _CLIMB, _DESCENT_SPEED: _CLIMB}
    for number, point in enumerate(mission.points, 1):
        if point.kind is PointKind.POI:
            continue
        if point.kind is PointKind.FAILSAFE:
            msg = f"point {number} is a fail-safe point, which a plan would fly to; choose .gpx, .kml, .csv or .wpl"
            raise ConfigError(msg)
        if point.speed != speed:
            items.append(_speed(items, _GROUND_SPEED, point.speed or _DEFAULT_SPEED))
        rate = _DESCENT_SPEED if point.altitude < height else _CLIMB_SPEED
        if point.climb != climbs[rate] and point.climb:
            items.append(_speed(items, rate, point.climb))
            climbs[rate] = point.climb
        if point.poi != poi:
            items.append(_roi(items, mission.points[point.poi - 1] if point.poi else None))
        if point.photo_distance != photo:
            items.append(_item(items, CAMERA_DISTANCE, [point.photo_distance, 0, 0, 0, 0, 0, 0], NO_FRAME))
        if point.camera_angle_deg not in (tilt, AUTOMATIC_CAMERA):
            items.append(_item(items, MOUNT_CONTROL, [-point.camera_angle_deg, 0, 0, 0, 0, 0, 2], NO_FRAME))
        speed, poi, photo, height = point.speed, point.poi, point.photo_distance, point.altitude
        tilt = tilt if point.camera_angle_deg == AUTOMATIC_CAMERA else point.camera_angle_deg
        place = [point.latitude_deg, point.longitude_deg, point.altitude]
        flown[len(items)] = number
        if point.kind is PointKind.LAND:
            items.append(_item(items, LAND, [0, 0, 0, point.heading_deg, *place], RELATIVE_FRAME))
        else:
            values = [point.hold, point.radius, 0, point.heading_deg, *place]
            items.append(_item(items, WAYPOINT, values, RELATIVE_FRAME))
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


def _speed(items: list[dict[str, Any]], kind: int, speed: float) -> dict[str, Any]:
    return _item(items, CHANGE_SPEED, [kind, speed, -1, 0, 0, 0, 0], NO_FRAME)


def _roi(items: list[dict[str, Any]], poi: MissionPoint | None) -> dict[str, Any]:
    if poi is None:
        return _item(items, ROI_NONE, [0, 0, 0, 0, 0, 0, 0], NO_FRAME)
    place = [poi.latitude_deg, poi.longitude_deg, poi.altitude]
    return _item(items, ROI_LOCATION, [0, 0, 0, 0, *place], RELATIVE_FRAME)


def _lines(text: str, count: int) -> list[int]:
    """Line on which each of the `count` mission items begins; line 1 if unknown."""
    start = next((m.end() for m in _ITEMS.finditer(text, text.find('"mission"'))), None)
    lines: list[int] = []
    decoder = json.JSONDecoder()
    while start is not None and len(lines) < count:
        while text[start] in " \t\r\n,":
            start += 1
        lines.append(text.count("\n", 0, start) + 1)
        start = decoder.raw_decode(text, start)[1]
    return lines or [1] * count


def _take(place: FilePlace, item: Any, reading: _Reading) -> None:
    """Add one mission item to what has been read."""
    if not isinstance(item, dict) or item.get("type") != "SimpleItem":
        kind = item.get("complexItemType", "complex item") if isinstance(item, dict) else "no object"
        raise place.wrong(f"a {kind} cannot be flown as it is", "replace it by waypoints in QGroundControl")
    params = item.get("params")
    if not isinstance(params, list) or len(params) != 7:
        raise place.wrong("an item needs 7 params", "save the plan again")
    # ArduPilot does not read autoContinue, and the programs written for it leave it at 0.
    if _is_waiting(item) and reading.autopilot != ARDUPILOT:
        raise place.wrong("the mission is to wait here (autoContinue)", "give the waypoint a hold time of up to 255 s")
    found = checked(place, item.get("command"), item.get("frame"), params, reading.autopilot)
    if reading.is_returning:
        raise place.wrong("nothing can be flown after a return to launch", "remove the return, or what follows it")
    reading.notes += (f"{place}: {note}" for note in found.notes)
    match found.command:
        case table.WAYPOINT | table.LOITER_TIME | table.LAND:
            _take_point(found, reading)
        case table.TAKEOFF:
            _take_take_off(found, reading)
        case table.RETURN:
            reading.is_returning = True
            reading.notes.append(f"{place}: return to launch: a NaviCtrl 0.24 flies home after the last point anyway")
        case table.CHANGE_SPEED:
            _take_speed(found, reading)
        case table.ROI_LOCATION | table.ROI:
            _take_region(found, reading)
        case table.ROI_NONE:
            reading.poi = None
        case table.MOUNT_CONTROL:
            angle = -round(found.needed(0))
            if not 0 <= angle < AUTOMATIC_CAMERA:
                raise found.refused(0)
            reading.camera_angle_deg = angle
        case table.CAMERA_DISTANCE:
            reading.photo_distance = _at_least_one(found, 0)


def _take_point(item: Item, reading: _Reading) -> None:
    is_land = item.command == table.LAND
    fields: dict[str, Any] = {
        "kind": PointKind.LAND if is_land else PointKind.WAYPOINT,
        "speed": reading.speed,
        "poi": reading.poi,
        "camera_angle_deg": reading.camera_angle_deg,
        "photo_distance": reading.photo_distance,
    }
    if item.command in (table.WAYPOINT, table.LOITER_TIME):
        fields["hold"] = _at_least_one(item, 0)
    if item.command == table.WAYPOINT and item.values[1] is not None:
        fields["radius"] = _at_least_one(item, 1)
    if item.values[3] is not None and reading.poi is None:
        # A plan's 0 is north, but a MikroKopter's 0 keeps the heading: north is 360 there.
        fields["heading_deg"] = round(item.values[3]) % 360 or 360
    reading.points.append(_position(item, reading, **fields))


def _take_take_off(item: Item, reading: _Reading) -> None:
    """The pilot or a client takes off: what a list can keep of it is the place and the height to fly to first."""
    if reading.points:
        raise item.place.wrong("a take-off after the first point cannot be flown", "remove the item")
    what = "a NaviCtrl's list begins in the air: take off by hand or with mkctl takeoff"
    if item.has_place:
        _take_point(item, reading)
        reading.notes.append(f"{item.place}: take-off is read as a waypoint: {what}")
    else:
        reading.notes.append(f"{item.place}: take-off without a place is left out: {what}")


def _take_speed(item: Item, reading: _Reading) -> None:
    kind, speed = item.needed(0), item.values[1]
    is_ground = kind == _GROUND_SPEED or (kind == _AIRSPEED and reading.autopilot == ARDUPILOT)
    if not is_ground and kind not in (_CLIMB_SPEED, _DESCENT_SPEED):
        raise item.refused(0)
    if speed is None:
        return
    if speed != _DEFAULT_SPEED and speed < _SLOWEST:
        raise item.refused(1)
    if is_ground:
        reading.speed = max(speed, 0.0)
        return
    rate = _CLIMB if speed == _DEFAULT_SPEED else speed
    if kind == _CLIMB_SPEED:
        reading.climb = rate
    else:
        reading.descent = rate


def _take_region(item: Item, reading: _Reading) -> None:
    is_ardupilot = reading.autopilot == ARDUPILOT
    if item.command == table.ROI:
        mode = item.needed(0)
        if mode not in (_ROI_MODE_NONE, _ROI_MODE_LOCATION):
            raise item.refused(0)
        if mode == _ROI_MODE_NONE and not (is_ardupilot and item.has_place):
            reading.poi = None
            return
    if is_ardupilot and not item.has_place:
        reading.poi = None
        return
    reading.points.append(_position(item, reading, kind=PointKind.POI))
    reading.poi = len(reading.points)


def _at_least_one(item: Item, index: int) -> int:
    """A whole number that a fraction above 0 does not make 0.

    Raises:
        ConfigError: it is negative.
    """
    value = item.values[index] or 0.0
    if value < 0.0:
        raise item.refused(index)
    return max(round(value), 1) if value else 0


def _position(item: Item, reading: _Reading, **fields: Any) -> MissionPoint:
    reference = FRAMES.get(item.frame) if isinstance(item.frame, int) else None
    if reference is None:
        raise item.place.wrong(f"altitude frame {item.frame} is not supported", "set the altitude mode to relative")
    latitude, longitude, altitude = item.needed(4), item.needed(5), item.needed(6)
    if not item.has_place:
        raise item.place.wrong("the place is 0 N 0 E, which programs write for none", "give the item a place")
    reading.references.add(reference)
    if fields["kind"] is not PointKind.POI:
        fields["climb"] = reading.climb_to(altitude)
    return item.place.point(latitude_deg=latitude, longitude_deg=longitude, altitude=altitude, **fields)
