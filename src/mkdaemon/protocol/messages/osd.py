"""NaviData: position, state and energy of the aircraft, as the NaviCtrl streams it.

Source: docs/protocol.md, "NaviData"; units: WIRE 8.1.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.fields import S8, S16, S32, U8, U16
from mkdaemon.protocol.flags import FlightStatus, FlightStatus2, FlightStatusOld, NaviStatus, PositionStatus
from mkdaemon.protocol.units import (
    BYTES_PER_S,
    CM_PER_S,
    DECIAMPERE,
    DECIMETRE,
    DECIVOLT,
    DEG,
    FIVE_CM,
    GLOBE,
    MAH,
    METRE,
    MILLIMETRE,
    SECOND,
    TEN_MS,
)
from mkdaemon.protocol.wire import Board, WireMessage, answer, request


def _asks_for_sets(payload: bytes) -> bool:
    """A byte budget follows the interval; the padding of the short form is zero."""
    return any(payload[1:3])


@request(
    Board.NC,
    "o",
    name="OsdRequest",
    layout="v1",
    reply="O",
    firmware="all NC",
    source="WIRE 8, OsdRequest_v1",
    recognise=lambda payload: not _asks_for_sets(payload),
    any_address=True,
)
class OsdRequestV1(WireMessage):
    """Stream NaviData; the first frame comes at once."""

    interval: Annotated[int, U8("Interval", TEN_MS)]
    """0 stops; below 3 the line is saturated."""


@request(
    Board.NC,
    "o",
    name="OsdRequest",
    layout="v2",
    reply="O",
    firmware="NC 2.14 and later",
    source="WIRE 8, OsdRequest_v2",
    since=(2, 14),
    recognise=_asks_for_sets,
    any_address=True,
)
class OsdRequestV2(WireMessage):
    """Stream the data sets 10..16."""

    interval: Annotated[int, U8("Interval", TEN_MS)]
    """0 stops."""
    max_bytes_per_s: Annotated[int, U16("MaxBytesPerSecond", BYTES_PER_S, low=1)]
    """Budget of all sets together; 200, 1024 or 0x8000 are in use."""


class _Place(WireMessage):
    """Where the aircraft is, should be and started."""

    version: Annotated[int, U8("Version")]
    position_longitude: Annotated[int, S32("CurrentPosition.Longitude", GLOBE)]
    position_latitude: Annotated[int, S32("CurrentPosition.Latitude", GLOBE)]
    position_altitude: Annotated[int, S32("CurrentPosition.Altitude", MILLIMETRE)]
    """GPS altitude."""
    position_status: Annotated[PositionStatus, U8("CurrentPosition.Status", enum=PositionStatus)]
    target_longitude: Annotated[int, S32("TargetPosition.Longitude", GLOBE)]
    target_latitude: Annotated[int, S32("TargetPosition.Latitude", GLOBE)]
    target_altitude: Annotated[int, S32("TargetPosition.Altitude", MILLIMETRE)]
    target_status: Annotated[PositionStatus, U8("TargetPosition.Status", enum=PositionStatus)]
    target_distance: Annotated[int, U16("TargetPositionDeviation.Distance", DECIMETRE)]
    target_bearing: Annotated[int, S16("TargetPositionDeviation.Bearing", DEG)]
    """Clockwise from north."""
    home_longitude: Annotated[int, S32("HomePosition.Longitude", GLOBE)]
    home_latitude: Annotated[int, S32("HomePosition.Latitude", GLOBE)]
    home_altitude: Annotated[int, S32("HomePosition.Altitude", MILLIMETRE)]
    home_status: Annotated[PositionStatus, U8("HomePosition.Status", enum=PositionStatus)]
    home_distance: Annotated[int, U16("HomePositionDeviation.Distance", DECIMETRE)]
    home_bearing: Annotated[int, S16("HomePositionDeviation.Bearing", DEG)]
    """Clockwise from north."""
    waypoint_index: Annotated[int, U8("WaypointIndex")]
    """1.. while a route runs, 0 otherwise."""
    waypoint_count: Annotated[int, U8("WaypointNumber")]
    """Stored waypoints without points of interest."""
    satellites: Annotated[int, U8("SatsInUse")]
    altimeter: Annotated[int, S16("Altimeter", FIVE_CM)]
    """Barometric height above the start."""
    variometer: Annotated[int, S16("Variometer", "5 cm per SPI step")]
    """Positive: climbing; rough."""
    flying_time: Annotated[int, U16("FlyingTime", SECOND)]
    battery: Annotated[int, U8("UBat", DECIVOLT)]
    ground_speed: Annotated[int, U16("GroundSpeed", CM_PER_S)]
    course: Annotated[int, S16("Heading", DEG)]
    """Course over ground, clockwise from north."""
    heading: Annotated[int, S16("CompassHeading", DEG)]
    """Clockwise from magnetic north."""
    pitch: Annotated[int, S8("AngleNick", DEG)]
    """Positive: nose down."""
    roll: Annotated[int, S8("AngleRoll", -DEG)]
    """Positive on the wire: LEFT side down."""
    rc_quality: Annotated[int, U8("RC_Quality")]
    """0..about 200."""


class _State(_Place):
    """What flies and how, up to the byte that changed its meaning."""

    fc_flags: Annotated[FlightStatus, U8("FCStatusFlags", enum=FlightStatus)]
    nc_flags: Annotated[NaviStatus, U8("NCFlags", enum=NaviStatus)]
    error_code: Annotated[ErrorCode, U8("Errorcode", enum=ErrorCode)]
    operating_radius: Annotated[int, U8("OperatingRadius", METRE)]
    """10 m a count on later NaviCtrls; from which release on is not verified."""
    vertical_speed: Annotated[int, S16("TopSpeed", CM_PER_S)]
    """From GPS."""
    target_hold_time: Annotated[int, U8("TargetHoldTime", SECOND)]
    """Remaining."""


class _State5(_State):
    fc_flags_2: Annotated[FlightStatus2, U8("FCStatusFlags2", enum=FlightStatus2)]


class _State4(_State):
    rc_rssi: Annotated[int, U8("RC_RSSI")]


class _Power(WireMessage):
    altitude_setpoint: Annotated[int, S16("SetpointAltitude", FIVE_CM)]
    throttle: Annotated[int, U8("Gas")]
    current: Annotated[int, U16("Current", DECIAMPERE)]
    used_capacity: Annotated[int, U16("UsedCapacity", MAH)]


@answer(
    Board.NC,
    "O",
    name="OsdData",
    key="osd",
    layout="5",
    firmware="NC 0.22 to 2.1x with the 1-byte request",
    source="WIRE 8.1, NaviData_v5",
    since=(0, 22),
    marker=frozenset({5}),
)
class OsdData5(_Power, _State5):
    """The whole state of the aircraft."""

    version: Annotated[int, U8("Version", only=frozenset({5}))] = 5


@answer(
    Board.NC,
    "O",
    name="OsdData",
    key="osd",
    layout="4",
    firmware="NC 0.18 to 0.22 (about)",
    source="WIRE 8.1, NaviData_v3_v4",
    marker=frozenset({3, 4}),
)
class OsdData4(_Power, _State4):
    """The whole state of the aircraft, before FC 0.82."""

    version: Annotated[int, U8("Version", only=frozenset({3, 4}))] = 4
    fc_flags: Annotated[FlightStatusOld, U8("FCStatusFlags", enum=FlightStatusOld)]  # type: ignore[assignment]
