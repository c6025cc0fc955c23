"""NaviData: position, state and energy of the aircraft, as the NaviCtrl streams it.

Source: docs/protocol.md, "NaviData"; units: `protocol.units`.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.errorcodes import ErrorCode
from mkdaemon.protocol.fields import S8, S16, S32, U8, U16
from mkdaemon.protocol.flags import FlightStatus, FlightStatus2, FlightStatusOld, NaviStatus, PositionStatus
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import StreamSpec
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
    source=Source.NC_RECEIVE,
    stream=StreamSpec("osd", renews=2),
    recognise=lambda payload: not _asks_for_sets(payload),
    any_address=True,
)
class OsdRequestV1(WireMessage):
    """Stream NaviData; the first frame comes at once."""

    interval: Annotated[int, U8(mk="Interval", unit=TEN_MS)]
    """0 stops; below 3 the line is saturated."""


@request(
    Board.NC,
    "o",
    name="OsdRequest",
    layout="v2",
    reply="O",
    firmware="NC 2.14 and later",
    since=(2, 14),
    source=(Source.WIKI, Source.UGCS),
    recognise=_asks_for_sets,
    any_address=True,
)
class OsdRequestV2(WireMessage):
    """Stream the data sets 10..16."""

    interval: Annotated[int, U8(mk="Interval", unit=TEN_MS)]
    """0 stops."""
    max_bytes_per_s: Annotated[int, U16(mk="MaxBytesPerSecond", unit=BYTES_PER_S, low=1)]
    """Budget of all sets together; 200, 1024 or 0x8000 are in use."""


class _Place(WireMessage):
    """Where the aircraft is, should be and started."""

    version: Annotated[int, U8(mk="Version")]
    position_longitude: Annotated[int, S32(mk="CurrentPosition.Longitude", unit=GLOBE)]
    position_latitude: Annotated[int, S32(mk="CurrentPosition.Latitude", unit=GLOBE)]
    position_altitude: Annotated[int, S32(mk="CurrentPosition.Altitude", unit=MILLIMETRE)]
    """GPS altitude."""
    position_status: Annotated[PositionStatus, U8(mk="CurrentPosition.Status", enum=PositionStatus)]
    target_longitude: Annotated[int, S32(mk="TargetPosition.Longitude", unit=GLOBE)]
    target_latitude: Annotated[int, S32(mk="TargetPosition.Latitude", unit=GLOBE)]
    target_altitude: Annotated[int, S32(mk="TargetPosition.Altitude", unit=MILLIMETRE)]
    target_status: Annotated[PositionStatus, U8(mk="TargetPosition.Status", enum=PositionStatus)]
    target_distance: Annotated[int, U16(mk="TargetPositionDeviation.Distance", unit=DECIMETRE)]
    target_bearing: Annotated[int, S16(mk="TargetPositionDeviation.Bearing", unit=DEG)]
    """Clockwise from north."""
    home_longitude: Annotated[int, S32(mk="HomePosition.Longitude", unit=GLOBE)]
    home_latitude: Annotated[int, S32(mk="HomePosition.Latitude", unit=GLOBE)]
    home_altitude: Annotated[int, S32(mk="HomePosition.Altitude", unit=MILLIMETRE)]
    home_status: Annotated[PositionStatus, U8(mk="HomePosition.Status", enum=PositionStatus)]
    home_distance: Annotated[int, U16(mk="HomePositionDeviation.Distance", unit=DECIMETRE)]
    home_bearing: Annotated[int, S16(mk="HomePositionDeviation.Bearing", unit=DEG)]
    """Clockwise from north."""
    waypoint_index: Annotated[int, U8(mk="WaypointIndex")]
    """1.. while a route runs, 0 otherwise."""
    waypoint_count: Annotated[int, U8(mk="WaypointNumber")]
    """Stored waypoints without points of interest."""
    satellites: Annotated[int, U8(mk="SatsInUse")]
    altimeter: Annotated[int, S16(mk="Altimeter", unit=FIVE_CM)]
    """Barometric height above the start."""
    variometer: Annotated[int, S16(mk="Variometer", unit="5 cm per SPI step")]
    """Positive: climbing; rough."""
    flying_time: Annotated[int, U16(mk="FlyingTime", unit=SECOND)]
    battery: Annotated[int, U8(mk="UBat", unit=DECIVOLT)]
    ground_speed: Annotated[int, U16(mk="GroundSpeed", unit=CM_PER_S)]
    course: Annotated[int, S16(mk="Heading", unit=DEG)]
    """Course over ground, clockwise from north."""
    heading: Annotated[int, S16(mk="CompassHeading", unit=DEG)]
    """Clockwise from magnetic north."""
    pitch: Annotated[int, S8(mk="AngleNick", unit=DEG)]
    """Positive: nose down."""
    roll: Annotated[int, S8(mk="AngleRoll", unit=-DEG)]
    """Positive on the wire: LEFT side down."""
    rc_quality: Annotated[int, U8(mk="RC_Quality")]
    """0..about 200."""


class _State(_Place):
    """What flies and how, up to the byte that changed its meaning."""

    fc_flags: Annotated[FlightStatus, U8(mk="FCStatusFlags", enum=FlightStatus)]
    nc_flags: Annotated[NaviStatus, U8(mk="NCFlags", enum=NaviStatus)]
    error_code: Annotated[ErrorCode, U8(mk="Errorcode", enum=ErrorCode)]
    operating_radius: Annotated[int, U8(mk="OperatingRadius", unit=METRE)]
    """10 m a count on later NaviCtrls; from which release on is not verified."""
    vertical_speed: Annotated[int, S16(mk="TopSpeed", unit=CM_PER_S)]
    """From GPS."""
    target_hold_time: Annotated[int, U8(mk="TargetHoldTime", unit=SECOND)]
    """Remaining."""


class _State5(_State):
    fc_flags_2: Annotated[FlightStatus2, U8(mk="FCStatusFlags2", enum=FlightStatus2)]


class _State4(_State):
    rc_rssi: Annotated[int, U8(mk="RC_RSSI")]


class _Power(WireMessage):
    altitude_setpoint: Annotated[int, S16(mk="SetpointAltitude", unit=FIVE_CM)]
    throttle: Annotated[int, U8(mk="Gas")]
    current: Annotated[int, U16(mk="Current", unit=DECIAMPERE)]
    used_capacity: Annotated[int, U16(mk="UsedCapacity", unit=MAH)]


@answer(
    Board.NC,
    "O",
    name="OsdData",
    key="osd",
    layout="5",
    firmware="NC 0.22 to 2.1x with the 1-byte request",
    since=(0, 22),
    source=Source.NC_SEND,
    marker=frozenset({5}),
    tells_firmware=True,
)
class OsdData5(_Power, _State5):
    """The whole state of the aircraft."""

    version: Annotated[int, U8(mk="Version", only=frozenset({5}))] = 5


@answer(
    Board.NC,
    "O",
    name="OsdData",
    key="osd",
    layout="4",
    firmware="NC 0.18 to 0.22 (about)",
    source=Source.TOOLS,
    marker=frozenset({3, 4}),
    tells_firmware=True,
)
class OsdData4(_Power, _State4):
    """The whole state of the aircraft, before FC 0.82."""

    version: Annotated[int, U8(mk="Version", only=frozenset({3, 4}))] = 4
    fc_flags: Annotated[FlightStatusOld, U8(mk="FCStatusFlags", enum=FlightStatusOld)]  # type: ignore[assignment]
