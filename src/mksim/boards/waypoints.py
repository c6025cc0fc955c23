"""The NaviCtrl's point list: what `w`, `x` and `s` do to it, and when it is flown.

Source: docs/firmware-notes, "Sending" 5; docs/protocol.md, sections 8 and 8.3.
"""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.protocol.flags import PointType, PositionStatus
from mkdaemon.protocol.messages import WriteWaypoint024

POINT_SIZE: Final = 30
_EARTH_RADIUS: Final = 6_371_000.0
_NO_WAYPOINTS: Final = (PointType.POINT_OF_INTEREST, PointType.INVALID)
_NO_HEADING: Final = 361
_EMPTY: Final = (
    WriteWaypoint024.decode(bytes(POINT_SIZE))
    .model_copy(update={"heading": _NO_HEADING, "type": PointType.INVALID})
    .encode()
)
"""A place of the list that nothing was written to since it was cleared."""


def distance_and_bearing(origin: tuple[int, int], place: tuple[int, int]) -> tuple[float, float]:
    """Distance [m] and compass bearing [deg] between two (longitude, latitude) pairs [1e-7 deg]."""
    scale = math.radians(1e-7) * _EARTH_RADIUS
    north = (place[1] - origin[1]) * scale
    east = (place[0] - origin[0]) * scale * math.cos(math.radians(origin[1] * 1e-7))
    return math.hypot(east, north), math.degrees(math.atan2(east, north)) % 360.0


class PointList:
    """Stored points and the route through them.

    Attributes:
        index: number of the waypoint being flown to, or flown to first, 1..; 0 while the list is not active.
        is_flown: the aircraft follows the list.
        is_over: the last waypoint has been held and the aircraft flies home.
        reached: the waypoint has been reached and is being held.
    """

    def __init__(self, size: int, *, ends_at_home: bool) -> None:
        self._size = size
        self._ends_at_home = ends_at_home
        self._points: dict[int, bytes] = {}
        self._held_since: float | None = None
        self.index = 0
        self.is_flown = self.is_over = self.reached = False

    @property
    def count(self) -> int:
        """Points stored, POIs included; a place withdrawn with the type INVALID keeps what was written there."""
        return sum(self._type(raw) is not PointType.INVALID for raw in self._points.values())

    @property
    def waypoints(self) -> int:
        """Points stored, POIs not included."""
        return sum(self._type(raw) not in _NO_WAYPOINTS for raw in self._points.values())

    @staticmethod
    def _type(raw: bytes) -> PointType:
        return WriteWaypoint024.decode(raw).type

    def write(self, raw: bytes) -> int:
        """Take a `w` payload; return what `W` carries: the index, or 0 for refused as well as cleared."""
        point = WriteWaypoint024.decode(raw)
        if point.status is PositionStatus.INVALID and point.index == 0:
            self.clear()
            return 0
        if not 1 <= point.index <= self._size:
            return 0
        self._points[point.index] = raw
        return point.index

    def clear(self) -> None:
        """Forget everything; a running route stops."""
        self._points.clear()
        self.stop()

    def read(self, index: int) -> bytes | None:
        """Return the payload of `X`: count, index and point; only the count above the last point; None for index 0."""
        if index == 0:
            return None
        if index > self.count:
            return bytes([self.count])
        raw = self._points.get(index, _EMPTY)
        return bytes([self.count, index]) + raw

    def activate(self) -> None:
        """Begin with the first waypoint as soon as the list is flown."""
        self.index = self._next_after(0)
        self.is_over = self.reached = False
        self._held_since = None

    def fly(self) -> None:
        """Follow the list from where it is."""
        self.is_flown = self.index > 0

    def pause(self) -> None:
        """Leave the list where it is."""
        self.is_flown = self.reached = False
        self._held_since = None

    def stop(self) -> None:
        """The list is not active any more."""
        self.index = 0
        self.is_over = False
        self.pause()

    def _next_after(self, index: int) -> int:
        later = sorted(
            number for number, raw in self._points.items() if number > index and self._type(raw) not in _NO_WAYPOINTS
        )
        return later[0] if later else 0

    @property
    def target(self) -> WriteWaypoint024 | None:
        """The waypoint being flown to."""
        if not self.is_flown or self.is_over:
            return None
        raw = self._points.get(self.index)
        return None if raw is None else WriteWaypoint024.decode(raw)

    def hold_left(self, now: float) -> float:
        """Remaining time at the reached waypoint [s]."""
        target = self.target
        if target is None or self._held_since is None:
            return 0.0
        return max(0.0, self._held_since + target.hold_time - now)

    def follow(self, place: tuple[int, int], now: float) -> None:
        """Note the aircraft's place; go on when a waypoint has been held long enough."""
        target = self.target
        if target is None:
            return
        away, _ = distance_and_bearing(place, (target.longitude, target.latitude))
        if not self.reached and away <= max(1, target.tolerance_radius):
            self.reached, self._held_since = True, now
        if self.reached and self.hold_left(now) <= 0.0:
            following = self._next_after(self.index)
            if following:
                self.index, self.reached, self._held_since = following, False, None
            elif self._ends_at_home:
                self.is_over, self.reached, self._held_since = True, False, None
