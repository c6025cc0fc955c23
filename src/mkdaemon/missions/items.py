"""Mission items of MAVLink: the one table of what each parameter of each accepted command becomes.

A parameter is used, says nothing, is reported, or its item is refused by name: nothing is left out in silence, because
a mission without it would be another one. Plans, `.waypoints` files and the MAVLink gateway read items by this table.
Sources: `MAV_CMD` of MAVLink's common message set, as pymavlink 2.4.50 has it; ArduPilot, `AP_Mission.cpp`
(mission_cmd_to_mavlink_int) and `ArduCopter/mode_auto.cpp`; PX4, `src/modules/mavlink/mavlink_mission.cpp`
(parse_mavlink_mission_item).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any, Final, NamedTuple

from mkdaemon.errors import ConfigError
from mkdaemon.missions.source import AltitudeReference, FilePlace

GENERIC, ARDUPILOT, PX4 = 0, 3, 12
"""Of `MAV_AUTOPILOT`: whose reading of an item counts; also `firmwareType` of a plan."""

WAYPOINT, LOITER_TIME, RETURN, LAND, TAKEOFF = 16, 19, 20, 21, 22
CHANGE_SPEED, ROI_LOCATION, ROI_NONE, ROI = 178, 195, 197, 201
MOUNT_CONTROL, CAMERA_DISTANCE = 205, 206

FRAMES: Final[Mapping[int, AltitudeReference]] = {
    0: AltitudeReference.SEA_LEVEL,
    5: AltitudeReference.SEA_LEVEL,
    3: AltitudeReference.START,
    6: AltitudeReference.START,
}
"""Frames in which a place is read, of `MAV_FRAME`."""
RELATIVE_FRAME, NO_FRAME = 3, 2
"""Frames that are written: of a place, and of an item without one."""


class Otherwise(StrEnum):
    """What happens with a value that says something, where no field of a point takes it."""

    REFUSED = "refused"
    """The item is refused."""
    NOTED = "noted"
    """The item is read without it, and a note says so."""
    NOTHING = "nothing"
    """It means nothing: MAVLink has no such parameter, or only for aircraft that cannot stand in the air."""


class Param(NamedTuple):
    """One of the seven parameters of a command.

    Attributes:
        word: what it is, for messages.
        field: the field of the point, or of those that follow, that takes it; empty for none.
        nothing: values that say nothing, beside an absent one or NaN.
        otherwise: what happens with any other value that `field` does not take.
        why: the reason, for messages and the page.
    """

    word: str
    field: str = ""
    nothing: tuple[float, ...] = (0.0,)
    otherwise: Otherwise = Otherwise.REFUSED
    why: str = ""


class MissionCommand(NamedTuple):
    """One command that is read.

    Attributes:
        word: what it is, for messages.
        params: its seven parameters, in their order.
    """

    word: str
    params: tuple[Param, Param, Param, Param, Param, Param, Param]


_EMPTY: Final = Param("empty", otherwise=Otherwise.NOTHING, why="MAVLink has no such parameter")
_PLACE: Final = (
    Param("latitude", "latitude_deg", ()),
    Param("longitude", "longitude_deg", ()),
    Param("altitude", "altitude", ()),
)
_YAW: Final = Param("yaw", "heading_deg", (), why="with a region of interest ahead of it, that decides")
_PLANE: Final = "of aircraft that cannot stand in the air"
_GIMBAL: Final = Param("gimbal", why="a MikroKopter has one camera")
_ONE_SHAPE: Final = (_EMPTY, _EMPTY, _EMPTY)

COMMANDS: Final[Mapping[int, MissionCommand]] = {
    WAYPOINT: MissionCommand(
        "waypoint",
        (
            Param("hold time", "hold"),
            Param("acceptance radius", "radius"),
            Param("pass radius", why="points are flown to, not past"),
            _YAW,
            *_PLACE,
        ),
    ),
    LOITER_TIME: MissionCommand(
        "timed loiter",
        (
            Param("hold time", "hold"),
            Param("heading required", otherwise=Otherwise.NOTHING, why=_PLANE),
            Param("loiter radius", otherwise=Otherwise.NOTHING, why=_PLANE),
            Param("yaw", "heading_deg", (0.0, 1.0), why="0 and 1 are exits of a circle, other numbers PX4's yaw"),
            *_PLACE,
        ),
    ),
    RETURN: MissionCommand("return to launch", (_EMPTY, _EMPTY, _EMPTY, _EMPTY, *_ONE_SHAPE)),
    LAND: MissionCommand(
        "land",
        (
            Param("abort altitude", why="the NaviCtrl does not abort a landing"),
            Param("precision landing", why="`mkctl land` lands by a target, the NaviCtrl does not"),
            _EMPTY,
            _YAW,
            *_PLACE,
        ),
    ),
    TAKEOFF: MissionCommand(
        "take-off",
        (
            Param("pitch", otherwise=Otherwise.NOTHING, why=_PLANE),
            _EMPTY,
            Param("flags", why="no flag of a take-off can be kept"),
            _YAW,
            *_PLACE,
        ),
    ),
    CHANGE_SPEED: MissionCommand(
        "speed",
        (
            Param("kind of speed", "speed, climb", (), why="1 is ground speed, 2 climb, 3 descent; 0 is airspeed"),
            Param("speed", "speed, climb", (-1.0,), why="-2 is the vehicle's own"),
            Param("throttle", nothing=(-2.0, -1.0, 0.0), why="a point has no throttle"),
            Param("relative speed", why="a point has an absolute speed"),
            *_ONE_SHAPE,
        ),
    ),
    ROI_LOCATION: MissionCommand("region of interest", (_GIMBAL, _EMPTY, _EMPTY, _EMPTY, *_PLACE)),
    ROI_NONE: MissionCommand("no region of interest", (_GIMBAL, _EMPTY, _EMPTY, _EMPTY, *_ONE_SHAPE)),
    ROI: MissionCommand(
        "region of interest",
        (
            Param("mode", "poi", (), why="3 is a place and 0 none, other modes cannot be kept"),
            Param("waypoint index", why="only a place can be looked at"),
            Param("region index", why="one region at a time"),
            _EMPTY,
            *_PLACE,
        ),
    ),
    MOUNT_CONTROL: MissionCommand(
        "camera tilt",
        (
            Param("pitch", "camera_angle_deg", (), why="a point tilts down, 0 to 254 degrees"),
            Param("roll", why="a point has only a tilt"),
            Param("yaw", why="a point has only a tilt; give the waypoint a yaw"),
            Param("altitude", why="use a region of interest"),
            Param("latitude", why="use a region of interest"),
            Param("longitude", why="use a region of interest"),
            Param("mode", nothing=(2.0,), why="2 is an angle; retract, neutral, RC and places cannot be kept"),
        ),
    ),
    CAMERA_DISTANCE: MissionCommand(
        "camera distance",
        (
            Param("distance", "photo_distance"),
            Param("shutter", nothing=(-1.0, 0.0), why="the camera decides"),
            Param("picture at once", otherwise=Otherwise.NOTED, why="the first picture comes after the first distance"),
            Param("camera", why="a MikroKopter has one camera"),
            *_ONE_SHAPE,
        ),
    ),
}
"""By number, of `MAV_CMD`. Any other command is refused by name."""

_READ_OTHERWISE: Final[Mapping[tuple[int, int, int], Param]] = {
    **{(ARDUPILOT, command, 3): _YAW._replace(nothing=(0.0,)) for command in (WAYPOINT, TAKEOFF)},
    (ARDUPILOT, LAND, 3): _YAW._replace(nothing=(-1.0, 0.0, 1.0)),
    (PX4, LOITER_TIME, 3): _YAW,
    (ARDUPILOT, CHANGE_SPEED, 0): COMMANDS[CHANGE_SPEED].params[0]._replace(why="0 and 1 are ground speed"),
    (ARDUPILOT, ROI, 0): COMMANDS[ROI].params[0]._replace(why="the mode is not read: all zeros end the region"),
}
"""Where an autopilot reads a parameter in another way: by autopilot, command and parameter, from 0. Copter stores no
yaw of these items and writes 0, of a landing -1 or 1, the turn of a plane's deep stall; PX4 turns a loitering
multicopter to param4; Copter's speed types 0 and 1 are one (do_change_speed); its do_roi looks at the place alone."""

NAMES: Final[Mapping[int, str]] = {
    17: "loiter", 18: "loiter turns", 31: "loiter to altitude", 82: "spline waypoint",
    84: "vertical take-off", 85: "vertical landing", 93: "delay", 112: "delay", 113: "change altitude",
    114: "distance", 115: "yaw", 177: "jump", 179: "set home", 181: "relay", 183: "servo", 189: "start of the landing",
    196: "region of interest at the next waypoint", 200: "camera control", 203: "camera trigger",
    530: "camera mode", 1000: "gimbal angles", 2000: "pictures", 2001: "end of pictures", 2500: "video",
    2501: "end of video",
}  # fmt: skip
"""Commands that are refused, for messages."""

_FIXES: Final[Mapping[int, str]] = {
    93: "give the waypoint before it a hold time",
    112: "give the waypoint before it a hold time",
    115: "give the waypoint a yaw",
    200: "use a camera trigger distance",
    203: "use a camera trigger distance",
    1000: "use camera tilt (DO_MOUNT_CONTROL)",
    2000: "use a camera trigger distance",
}


class Item(NamedTuple):
    """One item, checked by the table.

    Attributes:
        command: of `COMMANDS`.
        frame: of `MAV_FRAME`, as it came.
        values: seven numbers, finite; None for one that says nothing.
        notes: what is not kept of it, each in words.
        place: where it stands, for messages.
    """

    command: int
    frame: Any
    values: tuple[float | None, ...]
    notes: tuple[str, ...]
    place: FilePlace

    @property
    def has_place(self) -> bool:
        """Whether it names a place; 0 N 0 E is how programs leave it out."""
        return self.values[4] is not None and self.values[5] is not None and self.values[4:6] != (0.0, 0.0)

    def needed(self, index: int) -> float:
        """A parameter, from 0.

        Raises:
            ConfigError: it says nothing.
        """
        value = self.values[index]
        if value is None:
            raise self.place.wrong(f"{self.word(index)} is not given", "save the mission again")
        return value

    def word(self, index: int) -> str:
        """What a parameter is, from 0."""
        return COMMANDS[self.command].params[index].word

    def refused(self, index: int) -> ConfigError:
        """The error that refuses a parameter, from 0."""
        return _refusal(self.place, self.command, index, COMMANDS[self.command].params[index], self.values[index])


def checked(place: FilePlace, command: Any, frame: Any, params: Sequence[Any], autopilot: int) -> Item:
    """Check an item by the table.

    Args:
        place: where it stands, for messages.
        command: of `MAV_CMD`.
        frame: of `MAV_FRAME`.
        params: seven numbers; None or NaN for one that is not given.
        autopilot: of `MAV_AUTOPILOT`: whose reading counts.

    Raises:
        ConfigError: a command or a parameter that no point can express, or no finite number; names it and the fix.
    """
    spec = COMMANDS.get(command) if isinstance(command, int) and not isinstance(command, bool) else None
    if spec is None:
        known = NAMES.get(command, "") if isinstance(command, int) else ""
        fix = _FIXES.get(command, "") if isinstance(command, int) else ""
        raise place.wrong(
            f"MikroKopter points cannot express command {command}{f' ({known})' if known else ''}",
            fix or "remove the item",
        )
    if len(params) != len(spec.params):
        raise place.wrong("an item needs 7 params", "save the plan again")
    values: list[float | None] = []
    notes: list[str] = []
    for index, (param, given) in enumerate(zip(_params(autopilot, command, spec), params, strict=True)):
        value = place.given(param.word, given)
        says = value is not None and value not in param.nothing
        if says and not param.field and param.otherwise is Otherwise.REFUSED:
            raise _refusal(place, command, index, param, value)
        if says and param.otherwise is Otherwise.NOTED:
            notes.append(f"{param.word} {value:g} of {spec.word} is left out: {param.why}")
        values.append(value if says and param.field else None)
    return Item(command, frame, tuple(values), tuple(notes), place)


def _params(autopilot: int, command: int, spec: MissionCommand) -> list[Param]:
    return [_READ_OTHERWISE.get((autopilot, command, index), param) for index, param in enumerate(spec.params)]


def _refusal(place: FilePlace, command: int, index: int, param: Param, value: float | None) -> ConfigError:
    shown = "" if value is None else f" {value:g}"
    what = f"{param.word}{shown} of command {command} ({COMMANDS[command].word}) cannot be flown"
    return place.wrong(f"{what}: param{index + 1}, {param.why}", "correct or remove the item")
