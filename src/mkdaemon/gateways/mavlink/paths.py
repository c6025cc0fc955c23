"""Missions in a local frame: a path of the daemon in place of a list of the NaviCtrl.

The items are read by the table of `missions.items`. The daemon checks the path at upload (`do/path_upload`), flies it
at MISSION_START (`setpoint/path`), and reports how far it is (`control/path`). PX4 and ArduPilot refuse such missions:
their programs send them by MISSION_ITEM_INT with MAV_FRAME_LOCAL_NED (PX4 issue 23036, ArduPilot pull request 8748).
Source: https://mavlink.io/en/services/mission.html
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from pydantic import ValidationError

from mkdaemon.client import Vehicle
from mkdaemon.errors import ConfigError
from mkdaemon.gateways.mavlink.commands import Asked, CommandAnswered, accepted, denied
from mkdaemon.gateways.mavlink.dialect import Message, mavlink
from mkdaemon.gateways.mavlink.frames import compass_from_yaw
from mkdaemon.gateways.mavlink.missionitems import LOCAL_AXES, Item, NthItem, UnflyableError, params_of
from mkdaemon.gateways.mavlink.modes import Numbering, path_now
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.stations import By
from mkdaemon.gateways.mavlink.steering import ManualSteering, Order
from mkdaemon.missions import items as table
from mkdaemon.telemetry.path import MOST_PIECES, PathFlown, PathPoint, PathStored

SPEED: Final = 0.5
"""Speed of a path until an item gives one [m/s]; that of a `nav_msgs/Path` in ROS."""
FROM_THE_FIRST: Final = "a mission is flown from its first point"
_POINTS: Final = frozenset({table.WAYPOINT, table.LOITER_TIME})
_REMEDIES: Final[Mapping[int, str]] = {
    table.TAKEOFF: "take off by NAV_TAKEOFF, then start the mission",
    table.LAND: "land by NAV_LAND at its end",
    table.RETURN: "land by NAV_LAND at its end",
}
_GROUND_SPEED, _DEFAULT_SPEED = 1, -2


def is_path(items: Sequence[Item]) -> bool:
    """Whether a mission lies in a local frame."""
    return any(item.frame in LOCAL_AXES for item in items)


def points_of(items: Sequence[Item], first: int, autopilot: int) -> tuple[tuple[PathPoint, ...], tuple[int, ...]]:
    """The points of a path.

    Args:
        items: as they came.
        first: number of the first of them, for messages.
        autopilot: of `MAV_AUTOPILOT`: whose reading of the items counts.

    Returns:
        The points, and for each the index of its item.

    Raises:
        UnflyableError: an item that no path can have, or too few or too many points; names it and the remedy.
    """
    speed = SPEED
    points: list[PathPoint] = []
    flown: list[int] = []
    for index, item in enumerate(items):
        try:
            read = _checked(item, NthItem("item", index + first), autopilot)
            if item.command == table.CHANGE_SPEED:
                speed = _speed_of(read, speed, autopilot)
                continue
            points.append(_point_of(read, speed if points else None))
            flown.append(index)
        except ConfigError as error:
            raise UnflyableError(mavlink.MAV_MISSION_INVALID, str(error)) from error
        except ValidationError as error:
            mistake = error.errors()[0]
            words = f"item {index + first}: {mistake['loc'][0]}: {mistake['msg']}"
            raise UnflyableError(mavlink.MAV_MISSION_INVALID, words) from error
    if len(points) < 2:
        what = "a path has at least two points: fly to one place by DO_REPOSITION in LOCAL_NED"
        raise UnflyableError(mavlink.MAV_MISSION_INVALID, what)
    if len(points) > MOST_PIECES:
        what = f"{len(points)} points: a path has at most {MOST_PIECES}"
        raise UnflyableError(mavlink.MAV_MISSION_NO_SPACE, what)
    return tuple(points), tuple(flown)


def _checked(item: Item, place: NthItem, autopilot: int) -> table.Item:
    """Check an item by the table.

    Raises:
        UnflyableError: no path has such a command or frame.
        ConfigError: it has a number that no path takes.
    """
    if item.command not in _POINTS | {table.CHANGE_SPEED}:
        fix = _REMEDIES.get(item.command, "remove the item")
        known = table.COMMANDS[item.command].word if item.command in table.COMMANDS else table.NAMES.get(item.command)
        what = f"{place}: a path has no command {item.command}{f' ({known})' if known else ''}: {fix}"
        raise UnflyableError(mavlink.MAV_MISSION_UNSUPPORTED, what)
    if item.command in _POINTS and item.frame not in LOCAL_AXES:
        what = f"{place}: frame {item.frame} in a mission in a local frame: give all places in LOCAL_NED, or none"
        raise UnflyableError(mavlink.MAV_MISSION_UNSUPPORTED_FRAME, what)
    if not item.autocontinue and autopilot != table.ARDUPILOT:
        raise place.wrong("the mission is to wait here (autocontinue)", "give the waypoint a hold time")
    return table.checked(place, item.command, item.frame, params_of(item), autopilot)


def _speed_of(read: table.Item, before: float, autopilot: int) -> float:
    """The speed from an item on [m/s].

    Raises:
        ConfigError: it is of another kind.
    """
    kind, speed = read.needed(0), read.values[1]
    if kind != _GROUND_SPEED and not (kind == 0 and autopilot == table.ARDUPILOT):
        raise read.place.wrong(f"kind of speed {kind:g}: a path has a ground speed", "give kind 1")
    if speed is None:
        return before
    return SPEED if speed == _DEFAULT_SPEED else speed


def _point_of(read: table.Item, speed: float | None) -> PathPoint:
    """A point of a path.

    Raises:
        ConfigError: its place is not given.
        ValidationError: a number is out of range.
    """
    turn, (x, y, z) = read.values[3], read.values[4:]
    if x is None or y is None or z is None:
        raise read.place.wrong("a place in a local frame needs x, y and z", "give them in metres")
    return PathPoint(
        position=LOCAL_AXES[read.frame]((x, y, z)),
        speed=speed,
        stop=read.values[0],
        yaw=None if turn is None else compass_from_yaw(math.radians(turn)),
    )


@dataclass(frozen=True, slots=True)
class HeldPath:
    """A mission that is a path.

    Attributes:
        items: as they came, and are sent.
        stored: what the daemon answered.
        flown: for each point the index of its item.
    """

    items: tuple[Item, ...]
    stored: PathStored
    flown: tuple[int, ...]


class PathMission:
    """The path that was uploaded, and the flight along it.

    Attributes:
        held: the path; None where the mission is a list of the NaviCtrl, or nothing.
    """

    def __init__(self, uav: Vehicle, picture: LinkPicture, steering: ManualSteering) -> None:
        """Hold none.

        Args:
            uav: the vehicle.
            picture: what is known of it.
            steering: flies.
        """
        self.held: HeldPath | None = None
        self._uav, self._picture, self._steering = uav, picture, steering
        self._run, self._since = 0, 0.0
        self._reached = self._announced = 0

    async def store(self, items: Sequence[Item], first: int, autopilot: int) -> None:
        """Take a path in place of the one before; see `points_of`.

        Raises:
            MkError: it is none, or this aircraft cannot fly it; the one before stays.
        """
        points, flown = points_of(items, first, autopilot)
        stored = await self._uav.paths.upload(points=points)
        self.held = HeldPath(tuple(items), stored, flown)
        self._reached = self._announced = 0

    @property
    def is_flown(self) -> bool:
        """Whether a program flies along it, or wants to."""
        order = self._steering.order
        return order is not None and order.kind == "path"

    def is_flown_for(self, by: By) -> bool:
        """Whether a program flies along it."""
        order = self._steering.order
        return order is not None and order.by == by and self._progress() is not None

    async def start(self, asked: Asked) -> CommandAnswered:
        """MISSION_START: fly the path from its first point, or go on after a pause.

        Raises:
            MkError: it is refused, or the daemon does not begin.
        """
        held = self.held
        if held is None:
            return denied("no path is uploaded")
        first = held.flown[0] + (asked.by.station.numbering is Numbering.ARDUPILOT)
        if asked.command == mavlink.MAV_CMD_MISSION_START and (asked.number(1) or 0) > first:
            return denied(FROM_THE_FIRST)
        if self.is_flown_for(asked.by):
            return await self.pause(asked, is_paused=False)
        run, since = self._run + 1, self._picture.boot_time
        await self._steering.fly(Order(asked.by, "path", {"path": held.stored.id, "run": run, "paused": False}))
        self._run, self._since = run, since
        self._reached = self._announced = 0
        return accepted(f"flies the path: {held.stored.length:.1f} m in {held.stored.duration:.0f} s")

    async def pause(self, asked: Asked, *, is_paused: bool) -> CommandAnswered:
        """Stop on the path and hold there, or go on.

        Raises:
            MkError: it is refused.
        """
        order = self._steering.order
        if order is None or not self.is_flown_for(asked.by):
            return denied("no path is flown: MISSION_START begins at its first point")
        if order.fields["paused"] is not is_paused:
            await self._steering.fly(replace(order, fields={**order.fields, "paused": is_paused}))
        return accepted()

    def _progress(self) -> PathFlown | None:
        """How far this flight along the path is; None while it is not flown."""
        held, order, flown = self.held, self._steering.order, path_now(self._picture)
        if held is None or order is None or order.kind != "path" or flown is None:
            return None
        return flown if flown.id == held.stored.id and flown.stamp.monotonic >= self._since else None

    def current(self) -> Message | None:
        """MISSION_CURRENT; None where the mission is no path."""
        held, flown = self.held, self._progress()
        if held is None:
            return None
        if flown is not None and flown.progress > 0.0:
            at = flown.progress * held.stored.duration
            self._reached = sum(time <= at + 1e-6 for time in held.stored.times)
        is_complete = self._reached == len(held.flown) and (flown is None or flown.progress >= 1.0)
        if flown is None and not is_complete:  # the next flight begins at the first point
            self._reached = self._announced = 0
        state = mavlink.MISSION_STATE_NOT_STARTED
        if is_complete:
            state = mavlink.MISSION_STATE_COMPLETE
        elif flown is not None:
            state = mavlink.MISSION_STATE_PAUSED if flown.is_paused else mavlink.MISSION_STATE_ACTIVE
        seq = held.flown[min(self._reached, len(held.flown) - 1)]
        mode = 2 if flown is None or flown.is_paused else 1
        return mavlink.MAVLink_mission_current_message(seq, len(held.items) - 1, state, mode)

    def reached(self) -> list[Message]:
        """MISSION_ITEM_REACHED of each point that was reached since the last call."""
        if self.held is None or self.current() is None:
            return []
        new = self.held.flown[self._announced : self._reached]
        self._announced = self._reached
        return [mavlink.MAVLink_mission_item_reached_message(seq) for seq in new]
