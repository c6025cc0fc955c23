"""The modes of a MikroKopter as MAVLink numbers them.

The autopilot calls itself GENERIC: PX4 and ArduPilot would promise parameters, commands and flight modes that no
MikroKopter has, and QGroundControl would ask for their set-up. A GENERIC autopilot may number its modes as it likes,
but programs read its numbers as those of another autopilot: MAVSDK as PX4's (for every autopilot that is not
ArduPilot's), pymavlink and with it MAVProxy as those of ArduCopter (for every quadrotor that is not PX4's). So each
link has one of the two numberings, and may call itself PX4 for QGroundControl. AVAILABLE_MODES also gives the meaning
of each number, by name and by MAV_STANDARD_MODE.
Sources: https://mavlink.io/en/services/standard_modes.html; PX4 `px4_custom_mode.h`; ArduCopter `mode.h`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from mkdaemon.gateways.mavlink.dialect import Message, mavlink
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.telemetry.control import ControlStatus, Phase
from mkdaemon.telemetry.navi import ControlNavi, NaviStage
from mkdaemon.telemetry.path import PathFlown
from mkdaemon.telemetry.state import Flight, GpsMode
from mkdaemon.telemetry.tone import Tone


class Numbering(Enum):
    """Whose numbers a link has."""

    PX4 = "px4"
    """Main mode in bits 16 to 23, sub-mode in bits 24 to 31."""
    AS_PX4 = "as-px4"
    """The same, and HEARTBEAT calls the autopilot PX4: QGroundControl offers no button for a GENERIC one."""
    ARDUPILOT = "ardupilot"
    """ArduCopter's; besides, item 0 of a mission is the home position."""


class Mode(Enum):
    """What the aircraft does, and who decides it."""

    STABILIZED = "Stabilized"
    """The pilot flies: his sticks are angles and thrust; also a MANUAL_CONTROL of a ground station."""
    ALTITUDE = "Altitude"
    """The pilot flies with height control: his throttle is a rate of climb."""
    POSITION = "Position"
    """The NaviCtrl holds the place, by the pilot's GPS switch; also a ground station's sticks as velocities."""
    MISSION = "Mission"
    """The NaviCtrl flies its list, by the pilot's GPS switch; or the daemon flies along a path."""
    RETURN = "Return"
    """The NaviCtrl flies home, by the pilot's GPS switch."""
    TAKEOFF = "Takeoff"
    """The daemon takes off over the target."""
    LAND = "Land"
    """The daemon lands on the target; also the emergency landing of a FlightCtrl that has lost its receiver."""
    HOLD = "Hold"
    """The daemon holds the place over the target."""
    OFFBOARD = "Offboard"
    """A client's setpoints are flown."""


@dataclass(frozen=True, slots=True)
class ModeRow:
    """A mode as it is sent and understood.

    Attributes:
        mode: ours.
        px4: main mode and sub-mode.
        copter: ArduCopter's number for it.
        also: further numbers of ArduCopter's that ask for it.
        standard: of `MAV_STANDARD_MODE`; 0 where there is none.
        flags: of `MAV_MODE_FLAG`, without those of the moment.
        can_be_set: whether a ground station can ask for it and something may come of it.
    """

    mode: Mode
    px4: tuple[int, int]
    copter: int
    also: tuple[int, ...]
    standard: int
    flags: int
    can_be_set: bool = True


_CUSTOM = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_STICKS = _CUSTOM | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
"""The pilot's sticks always reach the FlightCtrl, and are added to whatever else steers."""
_GUIDED = _STICKS | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
_AUTO = _GUIDED | mavlink.MAV_MODE_FLAG_AUTO_ENABLED

ROWS: Final = (
    ModeRow(Mode.STABILIZED, (7, 0), 0, (1,), 0, _STICKS),
    ModeRow(Mode.ALTITUDE, (2, 0), 2, (), mavlink.MAV_STANDARD_MODE_ALTITUDE_HOLD, _STICKS, can_be_set=False),
    ModeRow(Mode.POSITION, (3, 0), 16, (), mavlink.MAV_STANDARD_MODE_POSITION_HOLD, _STICKS),
    ModeRow(Mode.MISSION, (4, 4), 3, (), mavlink.MAV_STANDARD_MODE_MISSION, _AUTO),
    ModeRow(Mode.RETURN, (4, 5), 6, (21,), mavlink.MAV_STANDARD_MODE_SAFE_RECOVERY, _AUTO),
    ModeRow(Mode.TAKEOFF, (4, 2), 13, (), mavlink.MAV_STANDARD_MODE_TAKEOFF, _AUTO),
    ModeRow(Mode.LAND, (4, 6), 9, (), mavlink.MAV_STANDARD_MODE_LAND, _AUTO),
    ModeRow(Mode.HOLD, (4, 3), 5, (17,), 0, _AUTO),
    ModeRow(Mode.OFFBOARD, (6, 0), 4, (20,), 0, _GUIDED),
)
"""Every mode. ArduCopter has no mode for a take-off, so it gets 13 (SPORT), which no MikroKopter has."""
_BY_MODE: Final = {row.mode: row for row in ROWS}
_BY_MANOEUVRE: Final = {"takeoff": Mode.TAKEOFF, "land": Mode.LAND, "hold": Mode.HOLD, "path": Mode.MISSION}
_BY_SWITCH: Final = {GpsMode.HOLD: Mode.POSITION, GpsMode.COME_HOME: Mode.RETURN}
_LIST_FLOWN: Final = frozenset({NaviStage.ROUTE, NaviStage.AT_POINT})


def row_of(mode: Mode) -> ModeRow:
    """The row of a mode."""
    return _BY_MODE[mode]


def number_of(mode: Mode, numbering: Numbering) -> int:
    """The `custom_mode` of a mode."""
    row = _BY_MODE[mode]
    return row.copter if numbering is Numbering.ARDUPILOT else row.px4[0] << 16 | row.px4[1] << 24


def mode_of_numbers(numbering: Numbering, main: int, sub: int) -> Mode | None:
    """The mode that a ground station asks for; None for one that no MikroKopter has.

    Args:
        numbering: of its link.
        main: PX4's main mode, or ArduCopter's number.
        sub: PX4's sub-mode; 0 of AUTO is its hold.
    """
    for row in ROWS:
        if numbering is Numbering.ARDUPILOT:
            if main == row.copter or main in row.also:
                return row.mode
        elif (main, sub) == row.px4:
            return row.mode
    if numbering is Numbering.ARDUPILOT:
        return None
    if (main, sub) == (1, 0):  # MANUAL: nothing of ours is more manual than its sticks
        return Mode.STABILIZED
    return Mode.HOLD if (main, sub) == (4, 0) else None


def mode_of_custom(numbering: Numbering, custom: int) -> Mode | None:
    """The mode of a `custom_mode`; None for one that no MikroKopter has."""
    if numbering is Numbering.ARDUPILOT:
        return mode_of_numbers(numbering, custom, 0)
    return mode_of_numbers(numbering, custom >> 16 & 0xFF, custom >> 24 & 0xFF)


def mode_of_standard(standard: int) -> Mode | None:
    """The mode of a `MAV_STANDARD_MODE`; None for one that no MikroKopter has."""
    return next((row.mode for row in ROWS if row.standard == standard != 0), None)


def path_now(picture: LinkPicture) -> PathFlown | None:
    """How far the flight along a path is; None while none is flown."""
    status = picture.get(ControlStatus)
    if status is None or status.manoeuvre != "path" or status.phase is Phase.ABORTED:
        return None
    return picture.get(PathFlown)


def mode_now(picture: LinkPicture, by_sticks: Mode | None = None) -> Mode:
    """What the aircraft does now.

    Args:
        picture: what is known.
        by_sticks: the mode in which a ground station's own sticks are flown; None while none are.
    """
    status, flight = picture.get(ControlStatus), picture.get(Flight)
    if flight is not None and flight.emergency_landing:
        return Mode.LAND
    if status is not None and status.phase.is_in_flight:
        if status.phase is Phase.LANDING:
            return Mode.LAND
        if status.phase is Phase.ABORTED:
            return Mode.HOLD
        if (path := path_now(picture)) is not None and path.is_paused:
            return Mode.HOLD
        return by_sticks or _BY_MANOEUVRE.get(status.manoeuvre or "", Mode.OFFBOARD)
    if flight is None:
        return Mode.STABILIZED
    navi = picture.get(ControlNavi)
    if flight.gps_mode is GpsMode.COME_HOME and navi is not None and navi.stage in _LIST_FLOWN:
        return Mode.MISSION
    height = Mode.ALTITUDE if flight.altitude_control else Mode.STABILIZED
    return _BY_SWITCH.get(flight.gps_mode, height)


def is_armed(picture: LinkPicture) -> bool:
    """Whether the motors turn, as far as the boards say."""
    flight = picture.get(Flight)
    return flight is not None and bool(flight.motors_running)


def heartbeat(picture: LinkPicture, mode: Mode, numbering: Numbering) -> Message:
    """HEARTBEAT: a quadrotor of a generic autopilot, or of what its link says. See the module for the numbers."""
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if is_armed(picture) else 0
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4 if numbering is Numbering.AS_PX4 else mavlink.MAV_AUTOPILOT_GENERIC,
        row_of(mode).flags | armed,
        number_of(mode, numbering),
        system_state(picture),
        3,
    )


def system_state(picture: LinkPicture) -> int:
    """`MAV_STATE`: standby and active by the motors; critical if the pilot must act; emergency as the boards report."""
    flight, link = picture.get(Flight), picture.link
    if flight is None or (link is not None and not link.condition.is_usable):
        return int(mavlink.MAV_STATE_UNINIT)
    if flight.emergency_landing:
        return int(mavlink.MAV_STATE_EMERGENCY)
    if flight.is_calibrating:
        return int(mavlink.MAV_STATE_CALIBRATING)
    if not flight.motors_running:
        return int(mavlink.MAV_STATE_STANDBY)
    return int(mavlink.MAV_STATE_CRITICAL if picture.known.tone is Tone.BAD else mavlink.MAV_STATE_ACTIVE)


def available_mode(index: int, numbering: Numbering) -> Message | None:
    """AVAILABLE_MODES of one mode, counted from 1; None where there is no such mode."""
    if not 1 <= index <= len(ROWS):
        return None
    row = ROWS[index - 1]
    properties = 0 if row.can_be_set else mavlink.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
    number = number_of(row.mode, numbering)
    return mavlink.MAVLink_available_modes_message(
        len(ROWS), index, row.standard, number, properties, row.mode.value.encode()
    )


def current_mode(mode: Mode, numbering: Numbering) -> Message:
    """CURRENT_MODE."""
    number = number_of(mode, numbering)
    return mavlink.MAVLink_current_mode_message(row_of(mode).standard, number, number)
