"""Mission items of MAVLink and points of a NaviCtrl: what an item cannot say of a point, and a point not of an item.

The conversion is that of QGroundControl's plans (`missions.qgc`), which hold the same items.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from mkdaemon.errors import ConfigError
from mkdaemon.gateways.mavlink.dialect import NAN, Message, mavlink
from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.gateways.mavlink.stations import Station
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
_NOT_GIVEN: Final = 0x7FFF_FFFF
"""A coordinate that is not given."""


class _Nth(FilePlace):
    """Which item something is about, for messages."""

    def __str__(self) -> str:
        return f"{self.name} {self.line}"


@dataclass(frozen=True, slots=True)
class LinkItem:
    """A mission item as it crosses the link.

    Attributes:
        command: of `MAV_CMD`.
        frame: of `MAV_FRAME`.
        params: four numbers, NaN for one that is not given.
        x: latitude [1e-7 deg].
        y: longitude [1e-7 deg].
        z: height [m].
        current: whether it is the next one.
        autocontinue: whether the mission goes on by itself.
    """

    command: int
    frame: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    current: int = 0
    autocontinue: int = 1

    def message(self, system: int, component: int, seq: int) -> Message:
        """MISSION_ITEM_INT to a program."""
        return mavlink.MAVLink_mission_item_int_message(
            system, component, seq, self.frame, self.command, self.current, self.autocontinue, *self.params,
            self.x, self.y, self.z,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Refused:
    """A mission that no MikroKopter can fly.

    Attributes:
        result: of `MAV_MISSION_RESULT`.
        reason: which item, why, and what to do.
    """

    result: int
    reason: str


def autopilot_of(station: Station) -> int:
    """Whose reading of mission items a station means, of `MAV_AUTOPILOT`."""
    return table.ARDUPILOT if station.numbering is Numbering.ARDUPILOT else table.GENERIC


def item_from(message: Message) -> LinkItem:
    """Read a MISSION_ITEM_INT or a MISSION_ITEM."""
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        x, y = _scaled(x), _scaled(y)
    params = (message.param1, message.param2, message.param3, message.param4)
    return LinkItem(message.command, message.frame, params, x, y, message.z, message.current, message.autocontinue)


def _scaled(degrees: float) -> int:
    return round(degrees * _E7) if math.isfinite(degrees) and abs(degrees) <= 180.0 else _NOT_GIVEN


def mission_of(
    items: Sequence[LinkItem], ground: float | None, first: int = 0, autopilot: int = table.GENERIC
) -> tuple[Mission, tuple[str, ...]] | Refused:
    """The mission of some items.

    Args:
        items: as they came.
        ground: height of home above the sea; None where it is not known [m].
        first: number of the first of them, for messages.
        autopilot: of `MAV_AUTOPILOT`: whose reading of the items counts.

    Returns:
        The mission, heights above home, with what is left out of it in words; or why there is none.
    """
    for number, item in enumerate(items, first):
        if item.command not in table.COMMANDS:
            result, what = mavlink.MAV_MISSION_UNSUPPORTED, _unsupported(item, number)
            return Refused(int(result), what)
        if item.command in _PLACED and item.frame not in table.FRAMES:
            what = f"item {number}: frame {item.frame} cannot be flown; set heights relative to home"
            return Refused(int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME), what)
    try:
        draft = qgc.draft_of([_plan_item(item) for item in items], _places(len(items), first), autopilot)
        if ground is None and draft.reference is AltitudeReference.SEA_LEVEL:
            what = "heights are above sea level, and that of home is not known; set heights relative to home"
            return Refused(int(mavlink.MAV_MISSION_INVALID), what)
        return draft.settled("mission", start_elevation=ground), draft.notes
    except ConfigError as error:
        return Refused(int(mavlink.MAV_MISSION_INVALID), str(error))


def _unsupported(item: LinkItem, number: int) -> str:
    try:
        qgc.draft_of([_plan_item(item)], [_Nth("item", number)])
    except ConfigError as error:
        return str(error)
    return f"item {number}: command {item.command} cannot be flown"


def _places(count: int, first: int) -> Iterable[FilePlace]:
    return (_Nth("item", number) for number in range(first, first + count))


def _plan_item(item: LinkItem) -> dict[str, Any]:
    place = (math.nan if number == _NOT_GIVEN else number / _E7 for number in (item.x, item.y))
    numbers = (*item.params, *place, item.z)
    return {
        "type": "SimpleItem",
        "command": item.command,
        "frame": _PLAIN.get(item.frame, item.frame),
        "autoContinue": bool(item.autocontinue),
        "params": [number if math.isfinite(number) else None for number in numbers],
    }


@dataclass(frozen=True, slots=True)
class HeldMission:
    """The mission that the NaviCtrl holds.

    Attributes:
        items: as they are sent.
        digest: of the list on the board.
        flown: for each item the point it flies to, from 1; None for none.
    """

    items: tuple[LinkItem, ...]
    digest: str
    flown: tuple[int | None, ...]

    def seq_of(self, point: int) -> int | None:
        """Number of the item that flies to a point; None where none does."""
        return self.flown.index(point) if point in self.flown else None


def held_from(
    points: Sequence[MissionPoint],
    digest: str,
    items: Sequence[LinkItem] | None = None,
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
        return HeldMission(tuple(_item_of(item, index == 0) for index, (item, _) in enumerate(made)), digest, flown)
    draft = qgc.draft_of([_plan_item(item) for item in items], _places(len(items), 0), autopilot)
    made_of = {
        index: number
        for number, index in enumerate(draft.origins, 1)
        if draft.mission.points[number - 1].kind is not PointKind.POI
    }
    return HeldMission(tuple(items), digest, tuple(made_of.get(index) for index in range(len(items))))


def _item_of(item: dict[str, Any], is_first: bool) -> LinkItem:
    numbers = [NAN if value is None else float(value) for value in item["params"]]
    return LinkItem(
        item["command"],
        {plain: full for full, plain in _PLAIN.items()}.get(item["frame"], item["frame"]),
        (numbers[0], numbers[1], numbers[2], numbers[3]),
        round(numbers[4] * _E7),
        round(numbers[5] * _E7),
        numbers[6],
        int(is_first),
    )
