"""Data sets 10..16 a NaviCtrl 2.14 and later streams in place of NaviData 5, each sent when it changed.

Source: docs/protocol.md, "NaviData". 17 and above are reserved.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.fields import S8, S16, S32, U8, U16, Text
from mkdaemon.protocol.flags import NaviStatus, OsdStatus, OsdStatus2
from mkdaemon.protocol.units import (
    DECIAMPERE,
    DECIMETRE,
    DECIVOLT,
    DEG,
    DM_PER_S,
    FIVE_CM,
    GLOBE,
    MAH,
    METRE,
    SECOND,
    TEN_METRE,
    TWO_DEG,
)
from mkdaemon.protocol.wire import Board, WireMessage, answer

_FIRMWARE = "NC 2.14 and later, with the 3-byte request"


class _Head(WireMessage):
    index: Annotated[int, U8("Index")]
    """Number of the data set."""
    longitude: Annotated[int, S32("Longitude", GLOBE)]
    latitude: Annotated[int, S32("Latitude", GLOBE)]
    altimeter: Annotated[int, S16("Altimeter", FIVE_CM)]
    """Barometric height above the start."""
    ground_speed: Annotated[int, U8("GroundSpeed", DM_PER_S)]
    """255: 91 km/h or more."""
    status: Annotated[OsdStatus, U8("OSDStatusFlags", enum=OsdStatus)]


@answer(
    Board.NC,
    "O",
    layout="10",
    firmware=_FIRMWARE,
    source="WIRE 8.1, NaviTiny_10",
    since=(2, 14),
    marker=frozenset({10}),
)
class OsdTiny(_Head):
    """Data set 10: position."""

    index: Annotated[int, U8("Index", only=frozenset({10}))] = 10
    camera: Annotated[int, U8("CamCtrlChar")]
    """Character: R recording, c ready, ! error."""
    reserved: Annotated[int, U8("reserve1")]


@answer(
    Board.NC,
    "O",
    layout="11",
    firmware=_FIRMWARE,
    source="WIRE 8.1, NaviFlags_11",
    since=(2, 14),
    marker=frozenset({11}),
    open_ended=True,
)
class OsdFlags(_Head):
    """Data set 11: flags; some releases append reserved bytes."""

    index: Annotated[int, U8("Index", only=frozenset({11}))] = 11
    status_2: Annotated[OsdStatus2, U8("OSDStatusFlags2", enum=OsdStatus2)]
    nc_flags: Annotated[NaviStatus, U8("NCFlags", enum=NaviStatus)]
    reserved_flags: Annotated[int, U8("ReserveFlags")]
    error_code: Annotated[ErrorCode, U8("Errorcode", enum=ErrorCode)]
    spoken: Annotated[int, U8("SpeakHoTT")]
    vario_character: Annotated[str, Text("VarioCharacter", 1, trim=False)]
    gps_mode_character: Annotated[str, Text("GPS_ModeCharacter", 1, trim=False)]
    lowest_max_pwm: Annotated[int, U8("BL_MinOfMaxPWM")]
    """Below 255: a motor controller limits."""


@answer(
    Board.NC,
    "O",
    layout="12",
    firmware=_FIRMWARE,
    source="WIRE 8.1, NaviTarget_12",
    since=(2, 14),
    marker=frozenset({12}),
)
class OsdTarget(_Head):
    """Data set 12: target."""

    index: Annotated[int, U8("Index", only=frozenset({12}))] = 12
    target_longitude: Annotated[int, S32("TargetLongitude", GLOBE)]
    target_latitude: Annotated[int, S32("TargetLatitude", GLOBE)]
    target_altitude: Annotated[int, S16("TargetAltitude")]
    """Unit not known."""
    rc_quality: Annotated[int, U8("RC_Quality")]
    """0..200."""


@answer(
    Board.NC,
    "O",
    layout="13",
    firmware=_FIRMWARE,
    source="WIRE 8.1, NaviHome_13",
    since=(2, 14),
    marker=frozenset({13}),
)
class OsdHome(_Head):
    """Data set 13: home and limits."""

    index: Annotated[int, U8("Index", only=frozenset({13}))] = 13
    home_longitude: Annotated[int, S32("HomeLongitude", GLOBE)]
    home_latitude: Annotated[int, S32("HomeLatitude", GLOBE)]
    home_altitude: Annotated[int, S16("HomeAltitude")]
    """Unit not known."""
    operating_radius: Annotated[int, U16("WP_OperatingRadius", METRE)]
    cell_count: Annotated[int, U8("LipoCellCount")]
    descend_range: Annotated[int, U8("DescendRange", TEN_METRE)]
    manual_range: Annotated[int, U8("ManualFlyingRange", TEN_METRE)]
    reserved_1: Annotated[int, U8("reserved1")]
    """OSDStatusFlags3 in the newest description."""
    reserved_2: Annotated[int, U8("reserved2")]


@answer(
    Board.NC,
    "O",
    layout="14",
    firmware=_FIRMWARE,
    source="WIRE 8.1, NaviDeviation_14",
    since=(2, 14),
    marker=frozenset({14}),
)
class OsdDeviation(_Head):
    """Data set 14: distances and attitude."""

    index: Annotated[int, U8("Index", only=frozenset({14}))] = 14
    flying_time: Annotated[int, U16("FlyingTime", SECOND)]
    home_distance: Annotated[int, U16("DistanceToHome", DECIMETRE)]
    home_bearing: Annotated[int, U8("HeadingToHome", TWO_DEG)]
    """Clockwise from north."""
    target_distance: Annotated[int, U16("DistanceToTarget", DECIMETRE)]
    target_bearing: Annotated[int, U8("HeadingToTarget", TWO_DEG)]
    """Clockwise from north."""
    pitch: Annotated[int, S8("AngleNick", DEG)]
    """Positive: nose down."""
    roll: Annotated[int, S8("AngleRoll", -DEG)]
    """Positive on the wire: LEFT side down."""
    satellites: Annotated[int, U8("SatsInUse")]


@answer(
    Board.NC, "O", layout="15", firmware=_FIRMWARE, source="WIRE 8.1, NaviWP_15", since=(2, 14), marker=frozenset({15})
)
class OsdWaypoint(_Head):
    """Data set 15: route."""

    index: Annotated[int, U8("Index", only=frozenset({15}))] = 15
    waypoint_index: Annotated[int, U8("WaypointIndex")]
    waypoint_count: Annotated[int, U8("WaypointNumber")]
    target_hold_time: Annotated[int, U8("TargetHoldTime", SECOND)]
    event_channel: Annotated[int, U8("WP_EventChannel")]
    reserved: Annotated[int, U8("reserve")]


@answer(
    Board.NC,
    "O",
    layout="16",
    firmware=_FIRMWARE,
    source="WIRE 8.1, NaviVolatile_16",
    since=(2, 14),
    marker=frozenset({16}),
)
class OsdVolatile(_Head):
    """Data set 16: energy and heading."""

    index: Annotated[int, U8("Index", only=frozenset({16}))] = 16
    battery: Annotated[int, U16("UBat", DECIVOLT)]
    current: Annotated[int, U16("Current", DECIAMPERE)]
    used_capacity: Annotated[int, U16("UsedCapacity", MAH)]
    variometer: Annotated[int, S8("Variometer")]
    course: Annotated[int, U8("Heading", TWO_DEG)]
    """Course over ground, clockwise from north."""
    heading: Annotated[int, U8("CompassHeading", TWO_DEG)]
    """Clockwise from magnetic north."""
    throttle: Annotated[int, U8("Gas")]
    shutter_count: Annotated[int, U16("ShutterCounter")]
    altitude_setpoint: Annotated[int, S16("SetpointAltitude", FIVE_CM)]
