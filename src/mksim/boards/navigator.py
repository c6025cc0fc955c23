"""What a NaviCtrl knows of the flight: GPS mode, home, route, errors and flags.

The FlightCtrl's values come over the SPI bus, fifty times a second; while that is dead the last ones stay. Source:
docs/firmware-notes, "A NaviCtrl 0.24 in flight"; docs/protocol.md, sections 8.2 to 8.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.flags import FlightStatus, FlightStatus2, NaviStatus, PositionStatus
from mksim.boards.external import RC_LOST
from mksim.boards.flightctrl_state import FcBoard
from mksim.boards.generations import NcFirmware
from mksim.boards.waypoints import PointList, distance_and_bearing
from mksim.physics.sensors import GpsReport

CONTROL_PERIOD: Final = 0.02
LINK_LOST: Final = 5.5
"""Silence after which the next check reports NO_SERIAL_LINK; echo, b and y do not count."""
LINK_CHECK_PERIOD: Final = 1.0
SERVO_STOP: Final = 0.08
"""Silence on the SPI bus after which the timer of the camera servos stops [s]."""
SERVO_EXCHANGES: Final = 50
"""Exchanges with the FlightCtrl after which it starts again."""
SERVOS_STOP: Final = b"\r\r\n Timer2 deinit...ok"
SERVOS_START: Final = b"\r\r\n Timer2 init...ok"
"""What the board prints then, in the middle of a frame too. Source: NaviCtrl 0.24, spi_slave.c `SPI0_UpdateBuffer`."""
FC_SILENT: Final = 0.5
"""Silence on the SPI bus that is error 3 [s]; the board looks once a second, which is not simulated."""
_STICKS_CENTRED: Final = 8
"""Pitch or roll beyond this override the position control [stick]; assumed."""
_MODE_HOLD: Final = 50
_MODE_HOME: Final = 180
_FIRST_POTI_CHANNEL: Final = 5
_USUAL_RADIUS: Final = 100
"""Around home where the FlightCtrl's set has another limit [m]."""


@dataclass(frozen=True, slots=True)
class WireTarget:
    """Where the aircraft flies to or flew to last: longitude, latitude [1e-7 deg], altitude as the wire has it."""

    place: tuple[int, int]
    altitude: int


class Navigator:
    """The part of the NaviCtrl that is not about the line.

    Attributes:
        flight: the FlightCtrl behind it.
        points: the waypoint list.
        home: longitude, latitude [1e-7 deg] where the motors were started, or the first fix was.
        home_altitude: by GPS there [mm].
        target: where it flies to in the mode coming home; stays when that ends, also when the list is cleared.
        deviation: north and east of where it was to be when it last held or flew to a place [m].
        camera_servos_on: the timer of the camera servos runs.
        prints: plain text for the host that is not out yet.
        is_overridden: the pilot moves pitch or roll.
    """

    def __init__(self, generation: NcFirmware, flight: FcBoard, now: float) -> None:
        """Begin without a fix, a home or a route."""
        self.flight = flight
        self._generation = generation
        self.points = PointList(generation.list_size, ends_at_home=generation.ends_at_home)
        self.home = (0, 0)
        self.home_altitude = 0
        self.target: WireTarget | None = None
        self.deviation = (0.0, 0.0)
        self.camera_servos_on = True
        self.prints = b""
        self.is_overridden = False
        self._held: tuple[int, int] | None = None
        self._link_at = now
        self._link_lost = False
        self._next_link_check = now + LINK_CHECK_PERIOD
        self._now = self._spi_at = now
        self._servos_wait = 0
        self._fix: GpsReport | None = None
        self._fc_flags = FlightStatus(0)
        self._fc_flags_2 = FlightStatus2(0)
        self._flew = 0.0
        self._was_running = False
        self._mode = NaviStatus.FREE

    @property
    def has_flight(self) -> bool:
        """Whether the SPI bus to the FlightCtrl is alive."""
        flight = self.flight
        return flight.now >= flight.booted_at and not flight.aircraft.faults.is_active("spi_lost")

    def navigate(self, now: float) -> None:
        """One turn of the control loop."""
        flight = self.flight
        gps = flight.aircraft.sensors.gps
        if gps.has_fix:
            self._fix = gps
        if now >= self._next_link_check:
            self._next_link_check += LINK_CHECK_PERIOD
            self._link_lost = now - self._link_at > LINK_LOST
        self._now = now
        if self.has_flight:
            self._spi_at = now
            self._exchange(now)
            self._start_servos()
        elif now - self._spi_at > SERVO_STOP:
            self._stop_servos()
            flight.aircraft.steer(None)
        flight.companion_error = int(self.error_code)

    def _stop_servos(self) -> None:
        """The bus has been silent: the camera servos wait until exchanges are regular again."""
        if not self._servos_wait:
            self._servos_wait = SERVO_EXCHANGES
            self.camera_servos_on = False
            self.prints += SERVOS_STOP

    def _start_servos(self) -> None:
        """One exchange more since the bus was silent."""
        if self._servos_wait:
            self._servos_wait -= 1
            if not self._servos_wait:
                self.camera_servos_on = True
                self.prints += SERVOS_START

    def _exchange(self, now: float) -> None:
        """One exchange with the FlightCtrl over the SPI bus."""
        flight, core, place = self.flight, self.flight.core, self._place
        flight.forced_heading = None
        if core.running and not self._was_running:
            self._set_home(place)
            self._flew = 0.0
        elif self._generation.home_at_first_fix and self.fix.has_fix and self.home == (0, 0):
            self._set_home(place)
        self._was_running = core.running
        if core.flying:
            self._flew += CONTROL_PERIOD
        mode = self._read_mode()
        if mode is not self._mode:
            self._mode = mode
            self._enter_mode(mode)
        self.points.follow(place, now)
        if mode is NaviStatus.COMING_HOME:
            self._aim()
        self._steer(place)
        self._fc_flags, self._fc_flags_2 = core.status(flight.live), core.status_2()
        core.take_pulses()

    def _set_home(self, place: tuple[int, int]) -> None:
        self.home, self.home_altitude = place, round(self.fix.altitude * 1000.0)

    def _enter_mode(self, mode: NaviStatus) -> None:
        """The pilot's switch: what becomes of the route."""
        if mode is not NaviStatus.COMING_HOME or not self.flight.core.flying:
            if self._generation.list_starts_in_flight:
                self.points.pause()
            else:
                self.points.stop()
            return
        if not self._generation.list_starts_in_flight:
            self.points.activate()
        self.points.fly()

    def _steer(self, place: tuple[int, int]) -> None:
        """Let the aircraft lean towards where it is to be; the pilot's sticks override that, and choose the place."""
        sticks = self.flight.core.receiver
        self.is_overridden = max(abs(sticks.pitch), abs(sticks.roll)) > _STICKS_CENTRED
        if self._mode is NaviStatus.FREE or not self.flight.core.flying or not self.fix.has_fix:
            self._held = None
            self.flight.aircraft.steer(None)
            return
        if self.is_overridden or self._held is None:
            self._held = place
        is_coming = self._mode is NaviStatus.COMING_HOME and self.target is not None
        wanted = self.target.place if is_coming and self.target is not None else self._held
        away, bearing = distance_and_bearing(place, wanted)
        toward = math.radians(bearing)
        self.deviation = (-away * math.cos(toward), -away * math.sin(toward))
        self.flight.aircraft.steer(None if self.is_overridden else (away * math.sin(toward), away * math.cos(toward)))

    def _aim(self) -> None:
        """Take the waypoint, or home where there is none, as the target."""
        point = self.points.target
        if point is not None:
            self.target = WireTarget((point.longitude, point.latitude), point.altitude)
        elif self.home != (0, 0):
            self.target = WireTarget(self.home, self.home_altitude)

    @property
    def _place(self) -> tuple[int, int]:
        return self.fix.longitude_1e7, self.fix.latitude_1e7

    @property
    def fix(self) -> GpsReport:
        """The position as the board shows it: 0.24 goes on with the last one when the GPS receiver is silent."""
        gps = self.flight.aircraft.sensors.gps
        if gps.has_fix or self._fix is None or self._generation.no_fix_status is not None:
            return gps
        return self._fix

    @property
    def position_status(self) -> PositionStatus:
        """Position.Status of what `fix` shows."""
        return self._generation.fix_status if self.fix.has_fix else PositionStatus.INVALID

    def _read_mode(self) -> NaviStatus:
        live, potis = self.flight.live, self.flight.core.potis
        if "gps_mode_channel" in live:
            number = live["gps_mode_channel"] - _FIRST_POTI_CHANNEL
            value = potis[number] if 0 <= number < len(potis) else 0
        else:
            value = live.evaluate("gps_mode_control", potis)
        if value > _MODE_HOME:
            return NaviStatus.COMING_HOME
        return NaviStatus.POSITION_HOLD if value > _MODE_HOLD else NaviStatus.FREE

    @property
    def operating_radius(self) -> int:
        """Around home, by the FlightCtrl's set [m]."""
        live = self.flight.live
        has_it = "gps_operating_radius" in live
        return live.evaluate("gps_operating_radius", self.flight.core.potis) if has_it else _USUAL_RADIUS

    def start_route(self) -> None:
        """`s`, and a list written while it is flown, restart the route; `s` flies it where the switch asks for it."""
        if not self.flight.core.flying:
            return
        self.points.activate()
        if self._mode is NaviStatus.COMING_HOME:
            self.points.fly()

    def point_written(self) -> None:
        """A point has been stored: a list received in flight becomes active, and is flown when the switch asks."""
        if self.points.is_flown:
            self.start_route()
        elif self._generation.list_starts_in_flight and self.flight.core.flying and self.points.index == 0:
            self.points.activate()

    @property
    def fits_flight(self) -> bool:
        """Whether both boards speak one SPI protocol: a NaviCtrl that steers wants the sticks of FlightCtrl 2.10."""
        return not self._generation.takes_control or self.flight.generation.release >= (2, 10, 0)

    @property
    def mode_name(self) -> str:
        """The GPS mode in words."""
        return (self._mode.name or "").replace("_", " ").lower()

    @property
    def flying_time(self) -> int:
        """Time in the air since the motors were started [s]."""
        return int(self._flew)

    @property
    def error_code(self) -> ErrorCode:
        """What is wrong, the gravest first."""
        flight = self.flight
        if self._now - self._spi_at > FC_SILENT:
            return ErrorCode.NO_FC
        if not self.fits_flight:
            return ErrorCode.FC_INCOMPATIBLE
        if flight.core.quality < RC_LOST:
            return ErrorCode.RC_LOST
        if not flight.aircraft.sensors.gps.has_fix:
            return ErrorCode.NO_GPS_FIX if self._fix is None else self._generation.no_fix_error
        return ErrorCode.NONE

    def feed_watchdog(self, now: float) -> None:
        """A frame that counts as a living serial link."""
        self._link_at = now

    def flags(self) -> NaviStatus:
        """NCFlags."""
        flags = self._mode
        if self._link_lost:
            flags |= NaviStatus.NO_SERIAL_LINK
        if self.points.reached:
            flags |= NaviStatus.TARGET_REACHED
        if self.is_overridden and self._mode is not NaviStatus.FREE:
            flags |= NaviStatus.MANUAL_CONTROL
        if self._generation.reports_gps_ok and self.flight.aircraft.sensors.gps.has_fix:
            flags |= NaviStatus.GPS_OK
        return flags

    def flight_status(self) -> FlightStatus:
        """FCStatusFlags as the SPI bus brought them last."""
        return self._fc_flags

    def flight_status_2(self) -> FlightStatus2:
        """FCStatusFlags2 as the SPI bus brought them last."""
        return self._fc_flags_2

    def decimetres(self, distance: float) -> int:
        """Return a distance [m] as the wire has it [dm]: bounded, or with the wrap of 0.24."""
        if self._generation.distance_wraps:
            return (round(distance * 100.0) & 0xFFFF) // 10
        return min(0xFFFF, round(distance * 10.0))
