"""Watches the NaviCtrl's own flight: which stage, how far, what the pilot's hands do. Pure.

Only the pilot's GPS switch makes the NaviCtrl fly. Its mode flags, waypoint number and distances show what it does.
Source: docs/waypoints.md, "Fly a target or a route"; docs/firmware-notes.md, section 8.
"""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.frames import enu_from_geodetic
from mkdaemon.telemetry.navi import NaviFlight, NaviStage
from mkdaemon.telemetry.state import Flight, Gps, GpsFix, GpsMode, Position

PERIOD: Final = 1.0
"""Between two reports of a stage that lasts [s]."""
SAME_PLACE: Final = 1.0
"""A target within this distance of home is home [m]."""
AT_HOME: Final = 5.0
"""Distance from home that counts as arrived [m]; GPS is good for 2 to 3 m."""
_QUIET: Final = frozenset({NaviStage.GROUND, NaviStage.FREE})

HANDS: Final = {
    NaviStage.GROUND: "takes off by hand, GPS switch at free",
    NaviStage.FREE: "flies",
    NaviStage.READY: "turns the GPS switch to coming home to fly the list, pitch and roll centred",
    NaviStage.HOLD: "keeps off pitch and roll; GPS switch to free takes over",
    NaviStage.ROUTE: "keeps off pitch and roll; GPS switch away from coming home stops it, to free takes over",
    NaviStage.AT_POINT: "keeps off pitch and roll; GPS switch to hold stays here, to free takes over",
    NaviStage.HOME: "keeps off pitch and roll; GPS switch to free takes over, then he lands by hand",
    NaviStage.OVERRIDDEN: "flies with the sticks; centred, they give the aircraft back to the NaviCtrl",
    NaviStage.NO_POSITION: "flies, now: GPS switch to free",
}
"""Pitch, roll and switch of the pilot, by stage."""
THROTTLE: Final = {
    True: "throttle in the middle: height control flies the height",
    False: "the throttle holds the height",
    None: "the throttle holds the height, unless height control is on",
}
"""Throttle of the pilot, by what is known of height control."""


class NaviWatch:
    """Follows what a NaviCtrl does with its position control."""

    def __init__(self, facts: VehicleFacts) -> None:
        """Begin with nothing known."""
        self._facts = facts
        self._shown: tuple[object, ...] = ()
        self._shown_at = float("-inf")
        self._list = (0, 0)
        self._list_changed_at = float("-inf")
        self._was_on_way = self._is_route_done = self._is_new_in_flight = False

    def look(self, now: float) -> NaviFlight | None:
        """Return what is new, or due again; None for nothing, and without a NaviCtrl."""
        flight = self._facts.newest(Flight, now)
        if flight is None or flight.gps_mode is GpsMode.UNKNOWN or flight.is_flying is None:
            return None
        gps = self._facts.newest(Gps, now)
        has_fix = gps is None or gps.fix is not GpsFix.NONE
        found = self._report(flight, self._facts.newest(Position, now) if has_fix else None)
        if found is None:
            return None
        news = (found.stage, found.waypoint, found.waypoints, found.is_route_done, found.is_home, found.hands)
        is_due = found.stage not in _QUIET and now - self._shown_at >= PERIOD
        if news == self._shown and not is_due:
            return None
        self._shown, self._shown_at = news, now
        return found

    def _report(self, flight: Flight, position: Position | None) -> NaviFlight | None:
        """What the NaviCtrl does; None while it last spoke before its list was changed."""
        changed_at = self._facts.list_changed_at
        if flight.stamp.monotonic <= changed_at:
            return None
        if changed_at > self._list_changed_at:
            self._list_changed_at = changed_at
            self._was_on_way = self._is_route_done = False
            self._is_new_in_flight = bool(flight.is_flying)
        home = None if position is None else position.home_distance
        self._follow_list(flight, is_homing=position is not None and _is_homing(flight, position))
        stage = self._stage(flight, position)
        if stage is NaviStage.GROUND:
            self._is_route_done = False
        hands = HANDS[stage]
        if stage not in _QUIET:
            hands += f"; {THROTTLE[flight.altitude_control]}"
        return NaviFlight(
            stage=stage,
            hands=hands,
            waypoint=flight.waypoint_index or 0,
            waypoints=flight.waypoint_count or 0,
            target_distance=flight.target_distance,
            home_distance=home,
            height=None if position is None else position.altitude_above_start,
            is_route_done=self._is_route_done,
            is_home=stage is NaviStage.HOME and home is not None and home <= AT_HOME,
        )

    def _follow_list(self, flight: Flight, *, is_homing: bool) -> None:
        """Notice the end of the list: the last point reached, or the target that has become home behind it."""
        at = (flight.waypoint_index or 0, flight.waypoint_count or 0)
        if at != self._list:
            self._list, self._was_on_way, self._is_route_done = at, False, False
        if not at[0] or at[0] < at[1] or flight.gps_mode is not GpsMode.COME_HOME:
            return
        self._is_route_done = self._is_route_done or flight.target_reached or (is_homing and self._was_on_way)
        self._was_on_way = self._was_on_way or not is_homing

    def _stage(self, flight: Flight, position: Position | None) -> NaviStage:
        if not flight.is_flying:
            return NaviStage.GROUND
        # A NaviCtrl 2.x begins to count with the switch; a 0.24 counts a list received in flight at once, and does not
        # fly one that it received on the ground.
        has_list = bool(flight.waypoint_index) or (self._is_new_in_flight and bool(flight.waypoint_count))
        if flight.gps_mode is GpsMode.FREE:
            return NaviStage.READY if has_list and not self._is_route_done else NaviStage.FREE
        if position is None:
            return NaviStage.NO_POSITION
        if flight.manual_control:
            return NaviStage.OVERRIDDEN
        if flight.gps_mode is GpsMode.HOLD:
            return NaviStage.READY if has_list and not self._is_route_done else NaviStage.HOLD
        if not has_list or (self._is_route_done and not flight.target_reached):
            return NaviStage.HOME
        return NaviStage.AT_POINT if flight.target_reached else NaviStage.ROUTE


def _is_homing(flight: Flight, position: Position) -> bool:
    """Whether the target is home."""
    target, home = flight.target_latitude_deg, position.home_latitude_deg
    if target is None or flight.target_longitude_deg is None or home is None or position.home_longitude_deg is None:
        return False
    origin = (math.radians(home), math.radians(position.home_longitude_deg), 0.0)
    place = (math.radians(target), math.radians(flight.target_longitude_deg), 0.0)
    east, north, _ = enu_from_geodetic(*place, origin)
    return math.hypot(east, north) <= SAME_PLACE
