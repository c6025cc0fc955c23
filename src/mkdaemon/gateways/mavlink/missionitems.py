"""Mission items of MAVLink and points of a NaviCtrl: what an item cannot say of a point, and a point not of an item.

The conversion is that of QGroundControl's plans (`missions.qgc`), which hold the same items.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.gateways.mavlink.commands import LOCAL_SCALE
from mkdaemon.gateways.mavlink.dialect import NAN, Message, mavlink
from mkdaemon.gateways.mavlink.frames import Vector3, ned_from_enu
from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.gateways.mavlink.stations import By, Station
from mkdaemon.missions import items as table
from mkdaemon.missions import qgc
from mkdaemon.missions.source import AltitudeReference, FilePlace
from mkdaemon.telemetry.mission import Mission, MissionPoint, PointKind

_PLAIN: Final = {
    int(mavlink.MAV_FRAME_GLOBAL_INT): int(mavlink.MAV_FRAME_GLOBAL),
    int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT): int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT),
}
"""Frames that mean the same as one of a plan."""
_PLACED: Final = frozenset(number for number, row in table.COMMANDS.items() if row.params[4].field)
"""Commands that have a place."""
_E7: Final = 1e7
LOCAL_AXES: Final[Mapping[int, Callable[[Vector3], Vector3]]] = {
    int(mavlink.MAV_FRAME_LOCAL_NED): ned_from_enu,
    int(mavlink.MAV_FRAME_LOCAL_ENU): lambda place: place,
}
"""Frames of a mission whose places are metres: east, north and up of a place there."""
_NOT_GIVEN: Final = 0x7FFF_FFFF
"""A coordinate that is not given."""


class NthItem(FilePlace):
    """Which item something is about, for messages."""

    def __str__(self) -> str:
        return f"{self.name} {self.line}"


Item = Message
"""A MISSION_ITEM_INT as it came, or as it is made of a point; `addressed` says to whom and under which number."""


def item_of(
    command: int, frame: int, params: Iterable[float], place: tuple[int, int, float], current: int = 0, more: int = 1
) -> Item:
    """An item.

    Args:
        command: of `MAV_CMD`.
        frame: of `MAV_FRAME`.
        params: four numbers, NaN for one that is not given.
        place: latitude and longitude [1e-7 deg], height [m].
        current: whether it is the next one.
        more: whether the mission goes on by itself.
    """
    return mavlink.MAVLink_mission_item_int_message(0, 0, 0, frame, command, current, more, *params, *place)


def addressed(item: Item, by: By, seq: int, *, is_old: bool) -> Message:
    """An item to a program; MISSION_ITEM where it asks in the old way."""
    scale = _scale_of(item.frame)
    last: tuple[float, ...] = (item.x / scale, item.y / scale, item.z) if is_old else (item.x, item.y, item.z)
    make = mavlink.MAVLink_mission_item_message if is_old else mavlink.MAVLink_mission_item_int_message
    params = (item.param1, item.param2, item.param3, item.param4)
    return make(*by.program, seq, item.frame, item.command, item.current, item.autocontinue, *params, *last)


class UnflyableError(MkError):
    """A mission that no MikroKopter can fly: which item, why, and what to do.

    Attributes:
        result: of `MAV_MISSION_RESULT`.
    """

    def __init__(self, result: int, reason: str) -> None:
        super().__init__(reason)
        self.result = int(result)


def autopilot_of(station: Station) -> int:
    """Whose reading of mission items a station means, of `MAV_AUTOPILOT`."""
    return table.ARDUPILOT if station.numbering is Numbering.ARDUPILOT else table.GENERIC


def item_from(message: Message) -> Item:
    """Read a MISSION_ITEM_INT or a MISSION_ITEM."""
    if message.get_type() == "MISSION_ITEM_INT":
        return message
    params = (message.param1, message.param2, message.param3, message.param4)
    place = (_scaled(message.x, message.frame), _scaled(message.y, message.frame), message.z)
    return item_of(message.command, message.frame, params, place, message.current, message.autocontinue)


def _scale_of(frame: int) -> float:
    """Of the first two numbers of a place: metres or degrees as a MISSION_ITEM_INT has them."""
    return LOCAL_SCALE if frame in LOCAL_AXES else _E7


def _scaled(number: float, frame: int) -> int:
    scaled = number * _scale_of(frame)
    return round(scaled) if abs(scaled) <= 180.0 * _E7 else _NOT_GIVEN


def mission_of(
    items: Sequence[Item], ground: float | None, first: int = 0, autopilot: int = table.GENERIC
) -> tuple[Mission, tuple[str, ...]]:
    """The mission of some items.

    Args:
        items: as they came.
        ground: height of home above the sea; None where it is not known [m].
        first: number of the first of them, for messages.
        autopilot: of `MAV_AUTOPILOT`: whose reading of the items counts.

    Returns:
        The mission, heights above home, with what is left out of it in words.

    Raises:
        UnflyableError: there is none.
    """
    for number, item in enumerate(items, first):
        if item.command not in table.COMMANDS:
            raise UnflyableError(mavlink.MAV_MISSION_UNSUPPORTED, _unsupported(item, number))
        if item.command in _PLACED and item.frame not in table.FRAMES:
            what = f"item {number}: frame {item.frame} cannot be flown; set heights relative to home, or use LOCAL_NED"
            raise UnflyableError(mavlink.MAV_MISSION_UNSUPPORTED_FRAME, what)
    try:
        draft = qgc.draft_of([_plan_item(item) for item in items], _places(len(items), first), autopilot)
        if ground is None and draft.reference is AltitudeReference.SEA_LEVEL:
            what = "heights are above sea level, and that of home is not known; set heights relative to home"
            raise UnflyableError(mavlink.MAV_MISSION_INVALID, what)
        return draft.settled("mission", start_elevation=ground), draft.notes
    except ConfigError as error:
        raise UnflyableError(mavlink.MAV_MISSION_INVALID, str(error)) from error


def _unsupported(item: Item, number: int) -> str:
    try:
        qgc.draft_of([_plan_item(item)], [NthItem("item", number)])
    except ConfigError as error:
        return str(error)
    return f"item {number}: command {item.command} cannot be flown"


def _places(count: int, first: int) -> Iterable[FilePlace]:
    return (NthItem("item", number) for number in range(first, first + count))


def params_of(item: Item) -> list[float | None]:
    """The seven numbers of an item; None for one that is not given."""
    scale = _scale_of(item.frame)
    place = (math.nan if number == _NOT_GIVEN else number / scale for number in (item.x, item.y))
    numbers = (item.param1, item.param2, item.param3, item.param4, *place, item.z)
    return [number if math.isfinite(number) else None for number in numbers]


def _plan_item(item: Item) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "command": item.command,
        "frame": _PLAIN.get(item.frame, item.frame),
        "autoContinue": bool(item.autocontinue),
        "params": params_of(item),
    }


@dataclass(frozen=True, slots=True)
class HeldMission:
    """The mission that the NaviCtrl holds.

    Attributes:
        items: as they are sent.
        digest: of the list on the board.
        flown: for each item the point it flies to, from 1; None for none.
    """

    items: tuple[Item, ...]
    digest: str
    flown: tuple[int | None, ...]

    def seq_of(self, point: int) -> int | None:
        """Number of the item that flies to a point; None where none does."""
        return self.flown.index(point) if point in self.flown else None


def held_from(
    points: Sequence[MissionPoint],
    digest: str,
    items: Sequence[Item] | None = None,
    autopilot: int = table.GENERIC,
) -> HeldMission:
    """What is sent of a list.

    Args:
        points: of the list.
        digest: of the list.
        items: those it was uploaded as; None to make them of the points.
        autopilot: of `MAV_AUTOPILOT`: whose reading of the items counted.

    Raises:
        ConfigError: a point that no item says, as a fail-safe point.
    """
    if not points:
        return HeldMission((), digest, ())
    made = qgc.items_of(Mission(points=tuple(points)))
    flown = tuple(point for _, point in made)
    if items is None:
        return HeldMission(tuple(_made_of(item, index == 0) for index, (item, _) in enumerate(made)), digest, flown)
    draft = qgc.draft_of([_plan_item(item) for item in items], _places(len(items), 0), autopilot)
    made_of = {
        index: number
        for number, index in enumerate(draft.origins, 1)
        if draft.mission.points[number - 1].kind is not PointKind.POI
    }
    return HeldMission(tuple(items), digest, tuple(made_of.get(index) for index in range(len(items))))


def _made_of(item: dict[str, Any], is_first: bool) -> Item:
    *params, x, y, z = (NAN if value is None else float(value) for value in item["params"])
    frame = {plain: full for full, plain in _PLAIN.items()}.get(item["frame"], item["frame"])
    return item_of(item["command"], frame, params, (round(x * _E7), round(y * _E7), z), int(is_first))
