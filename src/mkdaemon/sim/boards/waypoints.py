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


def distance_and_bearing(origin: tuple[int, int], place: tuple[int, int]) -> tuple[float, float]:
    """Distance [m] and compass bearing [deg] between two (longitude, latitude) pairs [1e-7 deg]."""
    scale = math.radians(1e-7) * _EARTH_RADIUS
    north = (place[1] - origin[1]) * scale
    east = (place[0] - origin[0]) * scale * math.cos(math.radians(origin[1] * 1e-7))
    return math.hypot(east, north), math.degrees(math.atan2(east, north)) % 360.0


class PointList:
    """Stored points and the route through them.

    Attributes:
        active: number of the waypoint being flown to, 1..; 0 while no route runs.
        reached: the active waypoint has been reached and is being held.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._points: dict[int, bytes] = {}
        self._held_since: float | None = None
        self.active = 0
        self.reached = False

    @property
    def count(self) -> int:
        """Points stored, POIs included."""
        return len(self._points)

    @property
    def waypoints(self) -> int:
        """Points stored, POIs not included."""
        return sum(self._type(raw) is not PointType.POINT_OF_INTEREST for raw in self._points.values())

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
        if point.type is PointType.INVALID:
            self._points.pop(point.index, None)
        else:
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
        raw = self._points.get(index, bytes(POINT_SIZE))
        return bytes([self.count, index]) + raw

    def start(self) -> None:
        """Begin with the first waypoint."""
        self.active = self._next_after(0)
        self.reached, self._held_since = False, None

    def stop(self) -> None:
        """No route runs."""
        self.active, self.reached, self._held_since = 0, False, None

    def _next_after(self, index: int) -> int:
        later = sorted(
            number
            for number, raw in self._points.items()
            if number > index and self._type(raw) is not PointType.POINT_OF_INTEREST
        )
        return later[0] if later else 0

    @property
    def target(self) -> WriteWaypoint024 | None:
        """The waypoint being flown to."""
        raw = self._points.get(self.active)
        return None if raw is None else WriteWaypoint024.decode(raw)

    def hold_left(self, now: float) -> float:
        """Remaining time at the reached waypoint [s]."""
        target = self.target
        if target is None or self._held_since is None:
            return 0.0
        return max(0.0, self._held_since + target.hold_time - now)

    def follow(self, place: tuple[int, int], now: float) -> None:
        """Note the aircraft's place; go on when a waypoint has been held long enough, stay at the last."""
        target = self.target
        if target is None:
            return
        away, _ = distance_and_bearing(place, (target.longitude, target.latitude))
        if not self.reached and away <= max(1, target.tolerance_radius):
            self.reached, self._held_since = True, now
        if self.reached and self.hold_left(now) <= 0.0:
            following = self._next_after(self.active)
            if following:
                self.active, self.reached, self._held_since = following, False, None
