"""Data sets 10..16 a NaviCtrl 2.14 and later streams in place of NaviData 5, each sent when it changed.

Source: docs/protocol.md, "NaviData". 17 and above are reserved.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.fields import S8, S16, S32, U8, U16, Text
from mkdaemon.protocol.flags import NaviStatus, OsdStatus, OsdStatus2
from mkdaemon.protocol.sources import Source
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


class OsdSet(WireMessage):
    """Common head of every data set."""

    index: Annotated[int, U8(mk="Index")]
    """Number of the data set."""
    longitude: Annotated[int, S32(mk="Longitude", unit=GLOBE)]
    latitude: Annotated[int, S32(mk="Latitude", unit=GLOBE)]
    altimeter: Annotated[int, S16(mk="Altimeter", unit=FIVE_CM)]
    """Barometric height above the start."""
    ground_speed: Annotated[int, U8(mk="GroundSpeed", unit=DM_PER_S)]
    """255: 91 km/h or more."""
    status: Annotated[OsdStatus, U8(mk="OSDStatusFlags", enum=OsdStatus)]


@answer(
    Board.NC,
    "O",
    layout="10",
    firmware=_FIRMWARE,
    since=(2, 14),
    source=(Source.WIKI, Source.UGCS),
    marker=frozenset({10}),
    tells_firmware=True,
)
class OsdTiny(OsdSet):
    """Data set 10: position."""

    index: Annotated[int, U8(mk="Index", only=frozenset({10}))] = 10
    camera: Annotated[int, U8(mk="CamCtrlChar")]
    """Character: R recording, c ready, ! error."""
    reserved: Annotated[int, U8(mk="reserve1")]


@answer(
    Board.NC,
    "O",
    layout="11",
    firmware=_FIRMWARE,
    since=(2, 14),
    source=(Source.WIKI, Source.UGCS),
    marker=frozenset({11}),
    open_ended=True,
    tells_firmware=True,
)
class OsdFlags(OsdSet):
    """Data set 11: flags; some releases append reserved bytes."""

    index: Annotated[int, U8(mk="Index", only=frozenset({11}))] = 11
    status_2: Annotated[OsdStatus2, U8(mk="OSDStatusFlags2", enum=OsdStatus2)]
    nc_flags: Annotated[NaviStatus, U8(mk="NCFlags", enum=NaviStatus)]
    reserved_flags: Annotated[int, U8(mk="ReserveFlags")]
    error_code: Annotated[ErrorCode, U8(mk="Errorcode", enum=ErrorCode)]
    spoken: Annotated[int, U8(mk="SpeakHoTT")]
    vario_character: Annotated[str, Text(mk="VarioCharacter", length=1, trim=False)]
    gps_mode_character: Annotated[str, Text(mk="GPS_ModeCharacter", length=1, trim=False)]
    lowest_max_pwm: Annotated[int, U8(mk="BL_MinOfMaxPWM")]
    """Below 255: a motor controller limits."""


@answer(
    Board.NC,
    "O",
    layout="12",
    firmware=_FIRMWARE,
    since=(2, 14),
    source=(Source.WIKI, Source.UGCS),
    marker=frozenset({12}),
    tells_firmware=True,
)
class OsdTarget(OsdSet):
    """Data set 12: target."""

    index: Annotated[int, U8(mk="Index", only=frozenset({12}))] = 12
    target_longitude: Annotated[int, S32(mk="TargetLongitude", unit=GLOBE)]
    target_latitude: Annotated[int, S32(mk="TargetLatitude", unit=GLOBE)]
    target_altitude: Annotated[int, S16(mk="TargetAltitude")]
    """Unit not known."""
    rc_quality: Annotated[int, U8(mk="RC_Quality")]
    """0..200."""


@answer(
    Board.NC,
    "O",
    layout="13",
    firmware=_FIRMWARE,
    since=(2, 14),
    source=(Source.WIKI, Source.UGCS),
    marker=frozenset({13}),
    tells_firmware=True,
)
class OsdHome(OsdSet):
    """Data set 13: home and limits."""

    index: Annotated[int, U8(mk="Index", only=frozenset({13}))] = 13
    home_longitude: Annotated[int, S32(mk="HomeLongitude", unit=GLOBE)]
    home_latitude: Annotated[int, S32(mk="HomeLatitude", unit=GLOBE)]
    home_altitude: Annotated[int, S16(mk="HomeAltitude")]
    """Unit not known."""
    operating_radius: Annotated[int, U16(mk="WP_OperatingRadius", unit=METRE)]
    cell_count: Annotated[int, U8(mk="LipoCellCount")]
    descend_range: Annotated[int, U8(mk="DescendRange", unit=TEN_METRE)]
    manual_range: Annotated[int, U8(mk="ManualFlyingRange", unit=TEN_METRE)]
    reserved_1: Annotated[int, U8(mk="reserved1")]
    """OSDStatusFlags3 in the newest description."""
    reserved_2: Annotated[int, U8(mk="reserved2")]


@answer(
    Board.NC,
    "O",
    layout="14",
    firmware=_FIRMWARE,
    since=(2, 14),
    source=Source.UGCS,
    marker=frozenset({14}),
    tells_firmware=True,
)
class OsdDeviation(OsdSet):
    """Data set 14: distances and attitude."""

    index: Annotated[int, U8(mk="Index", only=frozenset({14}))] = 14
    flying_time: Annotated[int, U16(mk="FlyingTime", unit=SECOND)]
    home_distance: Annotated[int, U16(mk="DistanceToHome", unit=DECIMETRE)]
    home_bearing: Annotated[int, U8(mk="HeadingToHome", unit=TWO_DEG)]
    """Clockwise from north."""
    target_distance: Annotated[int, U16(mk="DistanceToTarget", unit=DECIMETRE)]
    target_bearing: Annotated[int, U8(mk="HeadingToTarget", unit=TWO_DEG)]
    """Clockwise from north."""
    pitch: Annotated[int, S8(mk="AngleNick", unit=DEG)]
    """Positive: nose down."""
    roll: Annotated[int, S8(mk="AngleRoll", unit=-DEG)]
    """Positive on the wire: LEFT side down."""
    satellites: Annotated[int, U8(mk="SatsInUse")]


@answer(
    Board.NC,
    "O",
    layout="15",
    firmware=_FIRMWARE,
    since=(2, 14),
    source=Source.UGCS,
    marker=frozenset({15}),
    tells_firmware=True,
)
class OsdWaypoint(OsdSet):
    """Data set 15: route."""

    index: Annotated[int, U8(mk="Index", only=frozenset({15}))] = 15
    waypoint_index: Annotated[int, U8(mk="WaypointIndex")]
    waypoint_count: Annotated[int, U8(mk="WaypointNumber")]
    target_hold_time: Annotated[int, U8(mk="TargetHoldTime", unit=SECOND)]
    event_channel: Annotated[int, U8(mk="WP_EventChannel")]
    reserved: Annotated[int, U8(mk="reserve")]


@answer(
    Board.NC,
    "O",
    layout="16",
    firmware=_FIRMWARE,
    since=(2, 14),
    source=Source.UGCS,
    marker=frozenset({16}),
    tells_firmware=True,
)
class OsdVolatile(OsdSet):
    """Data set 16: energy and heading."""

    index: Annotated[int, U8(mk="Index", only=frozenset({16}))] = 16
    battery: Annotated[int, U16(mk="UBat", unit=DECIVOLT)]
    current: Annotated[int, U16(mk="Current", unit=DECIAMPERE)]
    used_capacity: Annotated[int, U16(mk="UsedCapacity", unit=MAH)]
    variometer: Annotated[int, S8(mk="Variometer")]
    course: Annotated[int, U8(mk="Heading", unit=TWO_DEG)]
    """Course over ground, clockwise from north."""
    heading: Annotated[int, U8(mk="CompassHeading", unit=TWO_DEG)]
    """Clockwise from magnetic north."""
    throttle: Annotated[int, U8(mk="Gas")]
    shutter_count: Annotated[int, U16(mk="ShutterCounter")]
    altitude_setpoint: Annotated[int, S16(mk="SetpointAltitude", unit=FIVE_CM)]
