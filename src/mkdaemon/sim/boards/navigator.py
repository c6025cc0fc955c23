"""What a NaviCtrl knows of the flight: GPS mode, home, route, errors and flags.

It learns and tells over the SPI bus, fifty times a second. Source: docs/protocol.md, sections 8.2 to 8.4.
"""

from __future__ import annotations

from typing import Final

from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.flags import FlightStatus, NaviStatus
from mkdaemon.sim.boards.external import RC_LOST
from mkdaemon.sim.boards.fc_board import FcBoard
from mkdaemon.sim.boards.generations import NcGeneration
from mkdaemon.sim.boards.waypoints import PointList

CONTROL_PERIOD: Final = 0.02
LINK_LOST: Final = 6.0
"""Silence after which NO_SERIAL_LINK is reported; echo, b and y do not count."""
_MODE_HOLD: Final = 50
_MODE_HOME: Final = 180
_FIRST_POTI_CHANNEL: Final = 5


class Navigator:
    """The part of the NaviCtrl that is not about the line.

    Attributes:
        flight: the FlightCtrl behind it.
        points: the waypoint list.
        home: longitude, latitude [1e-7 deg] where the motors were started.
        operating_radius: around home [m].
    """

    def __init__(self, generation: NcGeneration, flight: FcBoard, now: float) -> None:
        """Begin without a fix, a home or a route."""
        self.flight = flight
        self._generation = generation
        self.points = PointList(generation.list_size)
        self.home = (0, 0)
        self.operating_radius = 100
        self._link_at = now
        self._had_fix = False
        self._flew = 0.0
        self._was_running = False
        self._mode = NaviStatus.FREE

    def navigate(self, now: float) -> None:
        """One turn of the control loop."""
        flight, core = self.flight, self.flight.core
        gps = flight.aircraft.sensors.gps
        flight.forced_heading = None
        self._had_fix = self._had_fix or gps.has_fix
        if core.running and not self._was_running:
            self.home = (gps.longitude_1e7, gps.latitude_1e7)
            self._flew = 0.0
        self._was_running = core.running
        if core.flying:
            self._flew += CONTROL_PERIOD
        flight.companion_error = int(self.error_code)
        mode = self._read_mode()
        if mode is not self._mode:
            self._mode = mode
            if mode is NaviStatus.COMING_HOME and core.flying:
                self.points.start()
            else:
                self.points.stop()
        self.points.follow((gps.longitude_1e7, gps.latitude_1e7), now)
        core.take_pulses()

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

    def start_route(self) -> None:
        """`s`, and a list written while it is flown, restart the route."""
        if self.flight.core.flying:
            self.points.start()

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
        if flight.now < flight.booted_at:
            return ErrorCode.NO_FC
        if not self.fits_flight:
            return ErrorCode.FC_INCOMPATIBLE
        if flight.core.quality < RC_LOST:
            return ErrorCode.RC_LOST
        if not flight.aircraft.sensors.gps.has_fix:
            return ErrorCode.GPS_LOST if self._had_fix else ErrorCode.NO_GPS_FIX
        return ErrorCode.NONE

    def feed_watchdog(self, now: float) -> None:
        """A frame that counts as a living serial link."""
        self._link_at = now

    def flags(self, now: float) -> NaviStatus:
        """NCFlags."""
        flags = self._mode
        if now - self._link_at > LINK_LOST:
            flags |= NaviStatus.NO_SERIAL_LINK
        if self.points.reached:
            flags |= NaviStatus.TARGET_REACHED
        if self.flight.aircraft.sensors.gps.has_fix:
            flags |= NaviStatus.GPS_OK
        return flags

    def flight_status(self) -> FlightStatus:
        """FCStatusFlags as the SPI bus brought them."""
        return self.flight.core.status(self.flight.live)
