"""The data sets 10..16 of newer NaviCtrls: each says a part, and only when it changed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from mkdaemon.protocol.errorcodes import ErrorCode, is_fc_lost
from mkdaemon.protocol.flags import NaviStatus, OsdStatus, OsdStatus2
from mkdaemon.protocol.messages.osdsets import OsdDeviation, OsdFlags, OsdHome, OsdTarget, OsdVolatile, OsdWaypoint
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.state import Altitude, Battery, Flight, Gps, GpsFix, Position
from mkdaemon.translate.geometry import Home, attitude, east_north, position
from mkdaemon.translate.origin import Origin, State
from mkdaemon.translate.osd import error_text, gps_mode, pilot
from mkdaemon.translate.receiver import ReceiverWatch


@dataclass(slots=True)
class SetTranslator:
    """Remembers what one set says and another needs."""

    home: Home | None = None
    target: Home | None = None
    heading: float | None = None
    deviation: OsdDeviation | None = None
    waypoint: OsdWaypoint | None = None
    altitude_setpoint: float | None = None
    error: ErrorCode = ErrorCode.NONE
    receiver: ReceiverWatch = field(default_factory=ReceiverWatch)

    def states(self, message: WireMessage, origin: Origin) -> list[State]:
        """What one data set says."""
        states: list[State] = []
        if isinstance(message, OsdFlags):
            self.error = message.error_code
            self.receiver.look(message.error_code)
        if self._has_place(message):
            states.append(("state/position", self._position(message, origin)))
        if not is_fc_lost(self.error):
            states.append(("state/altitude", Altitude(**origin._asdict(), above_start=message.si("altimeter"))))
        if isinstance(message, OsdTarget):
            target = Home(message.si("target_latitude"), message.si("target_longitude"))
            self.target = target if message.target_latitude or message.target_longitude else None
        match message:
            case OsdFlags():
                states.append(("state/flight", self._flight(message, origin)))
                states.append(("state/gps", self._gps(message, origin)))
            case OsdTarget() if not is_fc_lost(self.error):
                states.append(("state/pilot", pilot(origin, float(message.rc_quality), sticks=None, throttle=None)))
            case OsdHome():
                self.home = Home(message.si("home_latitude"), message.si("home_longitude"))
            case OsdDeviation():
                self.deviation = message
            case OsdWaypoint():
                self.waypoint = message
            case OsdVolatile():
                self.heading = message.si("heading")
                self.altitude_setpoint = message.si("altitude_setpoint")
                if not is_fc_lost(self.error):
                    states.append(("state/battery", _battery(message, origin)))
        return states

    def attitude(self, message: WireMessage, origin: Origin) -> State | None:
        """Attitude of a degree's resolution, once the heading is known from another set."""
        if not isinstance(message, OsdDeviation) or self.heading is None:
            return None
        coarse = attitude(origin, roll=message.si("roll"), pitch=message.si("pitch"), heading=self.heading)
        return "state/attitude", coarse

    def _has_place(self, message: WireMessage) -> bool:
        """Whether a set, each of which begins with the place, carries one that is not old."""
        return bool(message.latitude or message.longitude) and self.receiver.has_position  # type: ignore[attr-defined]

    def _target_distance(self, message: OsdFlags) -> float | None:
        """How far the target is, which is known while the position is [m]."""
        if self.target is None or not self._has_place(message):
            return None
        return math.hypot(*east_north(message.si("latitude"), message.si("longitude"), self.target))

    def _position(self, message: WireMessage, origin: Origin) -> Position:
        return position(
            origin,
            latitude=message.si("latitude"),
            longitude=message.si("longitude"),
            altitude=None,
            above_start=None if is_fc_lost(self.error) else message.si("altimeter"),
            home=self.home,
            board_home_distance=None if self.deviation is None else self.deviation.si("home_distance"),
        )

    def _gps(self, flags: OsdFlags, origin: Origin) -> Gps:
        usable = bool(flags.nc_flags & NaviStatus.GPS_OK)
        return Gps(
            **origin._asdict(),
            satellites=None if self.deviation is None else self.receiver.satellites(self.deviation.satellites),
            fix=GpsFix.VALID if self._has_place(flags) else GpsFix.NONE,
            is_usable=usable and self.receiver.has_position,
            is_home_set=None if self.home is None else True,
        )

    def _flight(self, flags: OsdFlags, origin: Origin) -> Flight:
        is_lost, navi = is_fc_lost(self.error), flags.nc_flags

        def first(flag: OsdStatus) -> bool | None:
            return None if is_lost else bool(flags.status & flag)

        def second(flag: OsdStatus2) -> bool | None:
            return None if is_lost else bool(flags.status_2 & flag)

        return Flight(
            **origin._asdict(),
            motors_running=second(OsdStatus2.MOTORS_RUNNING),
            is_flying=second(OsdStatus2.FLYING),
            is_calibrating=first(OsdStatus.CALIBRATING),
            is_starting=second(OsdStatus2.STARTING),
            emergency_landing=second(OsdStatus2.EMERGENCY_LANDING),
            battery_low=first(OsdStatus.LOW_BATTERY),
            care_free=first(OsdStatus.CARE_FREE),
            altitude_control=first(OsdStatus.ALTITUDE_CONTROL),
            rc_failsafe=second(OsdStatus2.RC_FAILSAFE),
            waiting_for_takeoff=second(OsdStatus2.WAITING_FOR_TAKEOFF),
            auto_starting=second(OsdStatus2.AUTO_STARTING),
            auto_landing=second(OsdStatus2.AUTO_LANDING),
            gps_mode=gps_mode(navi),
            manual_control=bool(navi & NaviStatus.MANUAL_CONTROL),
            range_limit=bool(navi & NaviStatus.RANGE_LIMIT),
            target_reached=bool(navi & NaviStatus.TARGET_REACHED),
            serial_link_lost=bool(navi & NaviStatus.NO_SERIAL_LINK),
            error_code=int(flags.error_code),
            error=error_text(flags.error_code),
            flying_time=None if self.deviation is None or is_lost else self.deviation.si("flying_time"),
            waypoint_index=None if self.waypoint is None else self.waypoint.waypoint_index,
            waypoint_count=None if self.waypoint is None else self.waypoint.waypoint_count,
            target_distance=self._target_distance(flags),
            target_latitude_deg=None if self.target is None else self.target.latitude,
            target_longitude_deg=None if self.target is None else self.target.longitude,
            board_target_distance=None if self.deviation is None else self.deviation.si("target_distance"),
            altitude_setpoint=None if is_lost else self.altitude_setpoint,
        )


def _battery(message: OsdVolatile, origin: Origin) -> Battery:
    return Battery(
        **origin._asdict(),
        voltage=message.si("battery"),
        current=message.si("current"),
        used_mah=float(message.used_capacity),
        is_low=bool(message.status & OsdStatus.LOW_BATTERY),
    )
