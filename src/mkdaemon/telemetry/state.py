"""The aircraft in SI units: ENU world, FLU body.

Every value says when its bytes arrived and which message said so. A value is as old as its stamp says: nothing is
repeated to look fresh. An answer to a query adds `age`, the time since arrival [s].
"""

from enum import StrEnum

from mkdaemon.telemetry.base import Stamped

Vector3 = tuple[float, float, float]


class StateValue(Stamped):
    """Arrival of the frame's last byte, and its source."""

    source: str
    """Board and message, for example `nc/osd`."""


class AngleScale(StrEnum):
    """Reported angle over the commanded one; docs/control.md, "The attitude loop"."""

    STICKS = "sticks"
    """It reports that angle: a NaviCtrl."""
    FLIGHTCTRL = "flightctrl"
    """It reports 1.13 times that angle: a FlightCtrl itself, on a cable to it."""


class Attitude(StateValue):
    """Orientation: `state/attitude`."""

    quaternion: tuple[float, float, float, float]
    """Rotation ENU from FLU as (w, x, y, z)."""
    roll: float
    """Right side down positive [rad]."""
    pitch: float
    """Nose down positive [rad]."""
    yaw: float
    """Counter-clockwise from magnetic east, seen from above, in (-pi, pi] [rad]."""
    scale: AngleScale = AngleScale.STICKS
    """Of roll and pitch, as the board reports them."""


class Position(StateValue):
    """Position of the aircraft: `state/position`. Published only while the GPS position is valid."""

    latitude_deg: float
    """WGS-84 [deg]."""
    longitude_deg: float
    """WGS-84 [deg]."""
    altitude: float | None
    """By GPS, as the receiver gives it [m]; null where this message does not carry it."""
    altitude_above_start: float | None
    """By barometer, above the point of calibration [m]; null while the NaviCtrl does not hear the FlightCtrl, whose
    values then stay as they were."""
    position_enu: Vector3 | None
    """East, north, up of home [m]; null until home is known, and without up. Up is the barometer's."""
    home_latitude_deg: float | None
    """WGS-84 [deg]."""
    home_longitude_deg: float | None
    """WGS-84 [deg]."""
    home_distance: float | None
    """From home, over ground, from the two positions [m]; null until home is known."""
    board_home_distance: float | None = None
    """The same as the board says it [m]; a NaviCtrl 0.24 begins at 0 again every 655 m."""


class Altitude(StateValue):
    """Height by the barometer: `state/altitude`. It needs no GPS; not published without frames of the FlightCtrl."""

    above_start: float
    """Above the point of calibration [m], in the board's steps of 5 or 10 cm."""


class Velocity(StateValue):
    """Velocity: `state/velocity`. Published only while the GPS position is valid."""

    velocity_enu: Vector3
    """By GPS: east, north, up [m/s]."""
    ground_speed: float
    """[m/s]."""
    course: float
    """Direction of travel, counter-clockwise from east [rad]."""
    climb_rate: float
    """Up positive, by GPS [m/s]."""


class Battery(StateValue):
    """Energy: `state/battery`."""

    voltage: float
    """[V]."""
    current: float | None
    """[A]; null where the board does not measure it."""
    used_mah: float | None
    """Charge taken since power-on [mAh]."""
    is_low: bool | None
    """The board's own alarm; null where this message does not carry it."""


class GpsFix(StrEnum):
    """Validity of the board's position."""

    NONE = "none"
    VALID = "valid"


class Gps(StateValue):
    """Reception: `state/gps`."""

    satellites: int | None
    """Used for the solution; null where this message does not say, and while nothing comes from the receiver."""
    fix: GpsFix
    """Whether the current position is valid; `none` also while the board shows the last position of a dead receiver."""
    is_usable: bool
    """The board's own judgement (GPS_OK): good enough to hold position."""
    is_home_set: bool | None
    """Whether a home position is stored; null where this message does not say."""


class GpsMode(StrEnum):
    """Mode of the NaviCtrl's position control."""

    FREE = "free"
    HOLD = "hold"
    COME_HOME = "come_home"
    UNKNOWN = "unknown"

    @property
    def steers(self) -> bool:
        """Whether the NaviCtrl adds its own sticks."""
        return self in {GpsMode.HOLD, GpsMode.COME_HOME}


class Flight(StateValue):
    """State of the flight: `state/flight`."""

    motors_running: bool | None
    """At least one motor turns by the FlightCtrl's will; null while the NaviCtrl does not hear the FlightCtrl, whose
    flags then stay as they were."""
    is_flying: bool | None
    """The FlightCtrl counts itself as in the air; null as above."""
    is_calibrating: bool | None
    """A pulse: sensors are being calibrated; null as above."""
    is_starting: bool | None
    """A pulse: motors are being started; null as above."""
    emergency_landing: bool | None
    """Receiver lost: emergency throttle, then motors off; null as above."""
    battery_low: bool | None
    """The FlightCtrl's own alarm; null as above."""
    care_free: bool | None
    """Null where the firmware does not say, and as above."""
    altitude_control: bool | None
    """The throttle stick commands climb, not thrust; null where the firmware does not say, and as above."""
    rc_failsafe: bool | None
    """The receiver signals its own fail-safe; null where the firmware does not say, and as above."""
    waiting_for_takeoff: bool | None
    """Null where the firmware does not say, and as above."""
    auto_starting: bool | None
    """Null where the firmware does not say, and as above."""
    auto_landing: bool | None
    """Null where the firmware does not say, and as above."""
    gps_mode: GpsMode
    """The switch the NaviCtrl follows."""
    manual_control: bool
    """The pilot's sticks override position control."""
    range_limit: bool
    """The operating radius has been reached."""
    target_reached: bool
    """Within the tolerance radius of the target."""
    serial_link_lost: bool
    """The NaviCtrl has not heard a command for 5 s."""
    error_code: int
    """Of the NaviCtrl; 0 for none."""
    error: str
    """The same in words."""
    flying_time: float | None
    """In the air [s]; null as above."""
    waypoint_index: int | None
    """Waypoint on the way to, from 1; 0 for none."""
    waypoint_count: int | None
    """Waypoints stored."""
    target_distance: float | None
    """To the target the NaviCtrl flies to, over ground, from the two positions [m]."""
    target_latitude_deg: float | None = None
    """Of the target, WGS-84 [deg]; null where there is none."""
    target_longitude_deg: float | None = None
    """Of the target, WGS-84 [deg]."""
    board_target_distance: float | None = None
    """The same as the board says it [m]; a NaviCtrl 0.24 begins at 0 again every 655 m."""
    altitude_setpoint: float | None
    """Of altitude control, above start [m]; null while it is off or not reported, and as above."""


class Pilot(StateValue):
    """The pilot's signals as received: `state/pilot`."""

    rc_quality: float
    """Receiver quality, 0..1; the FlightCtrl flies below 0.5 only in an emergency."""
    has_signal: bool
    """Whether the quality suffices to fly (100 of 200 and more)."""
    throttle: float | None
    """Pilot's throttle, where the board reports it [stick from the centre]."""
    sticks: Vector3 | None
    """Pilot's pitch, roll, yaw, FLU signs, where the board reports them [stick]."""
    throttle_in_use: float | None = None
    """Throttle the FlightCtrl flies with: on stock firmware the smaller of the pilot's and ours [stick from the
    centre]; null where the board does not report it, and while motors stand."""
    is_gate_open: bool | None = None
    """Whether the pilot's gate is open, where the board reports it: a public fork."""
    compensated_at: float | None = None
    """Voltage of the battery in this message, where `throttle_in_use` is what the FlightCtrl made of its stick by it
    [V]: the stick times the voltage of its low-battery warning over this; null where it is the stick itself."""
