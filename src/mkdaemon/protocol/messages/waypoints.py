"""Routes: points the NaviCtrl stores and flies to. 30 bytes in every release; the tail changed its meaning.

Source: docs/protocol.md, "Points"; docs/firmware-notes.md, section 4.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import S16, S32, U8, Text
from mkdaemon.protocol.flags import PointEvent, PointType, PositionStatus
from mkdaemon.protocol.matching import same
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.units import DECIMETRE, DEG, DM_PER_S, GLOBE, METRE, SECOND
from mkdaemon.protocol.wire import Board, WireMessage, answer, request
from mkdaemon.telemetry.danger import Confirm, Danger

_OLD = "NC up to 0.20 (about)"
_024 = "NC 0.22 to 0.26"
_027 = "NC 0.27 to 2.0x"
_2X = "NC 2.0x with automatic photo, and later"
_TARGET_DANGER = Danger(effect="flies to a point in coming-home mode", confirm=Confirm.ALWAYS, proven=True)
_WRITE_DANGER = Danger(
    effect="changes the running route; status INVALID with index 0 clears it", confirm=Confirm.IN_FLIGHT, proven=True
)


class _Point(WireMessage):
    longitude: Annotated[int, S32(mk="Position.Longitude", unit=GLOBE, limit=1_800_000_000)]
    """WGS 84, east positive."""
    latitude: Annotated[int, S32(mk="Position.Latitude", unit=GLOBE, limit=900_000_000)]
    """WGS 84, north positive."""
    altitude: Annotated[int, S32(mk="Position.Altitude", unit=DECIMETRE)]
    """Waypoints: dm above the start. Points of interest: dm on NC 2.x, cm up to 0.28; read back to be sure."""
    status: Annotated[PositionStatus, U8(mk="Position.Status", enum=PositionStatus)]
    """NEW to act on it; INVALID with index 0 clears the list."""
    heading: Annotated[int, S16(mk="Heading", unit=DEG)] = 0
    """0 leaves it, 1..360 clockwise from north, negative: minus the list index of a point of interest to look at."""
    tolerance_radius: Annotated[int, U8(mk="ToleranceRadius", unit=METRE)] = 0
    """Within it the point counts as reached."""
    hold_time: Annotated[int, U8(mk="HoldTime", unit=SECOND)] = 0
    """To stay once reached."""
    event: Annotated[PointEvent, U8(mk="Event_Flag", enum=PointEvent)] = PointEvent.NONE


class _PointOld(_Point):
    reserved: Annotated[tuple[int, ...], U8(mk="reserve", count=12)] = (0,) * 12


class _PointListed(_Point):
    index: Annotated[int, U8(mk="Index")]
    """1.. in the list (to 31 on 0.24)."""
    type: Annotated[PointType, U8(mk="Type", enum=PointType)] = PointType.WAYPOINT
    event_channel: Annotated[int, U8(mk="WP_EventChannelValue")] = 0
    """Appears on the FlightCtrl as a channel while the point is held."""
    altitude_rate: Annotated[int, U8(mk="AltitudeRate", unit=DM_PER_S)] = 0
    """Climb and descent towards its altitude."""


class _Point024(_PointListed):
    reserved: Annotated[tuple[int, ...], U8(mk="reserve", count=8)] = (0,) * 8


class _PointNamed(_PointListed):
    speed: Annotated[int, U8(mk="Speed", unit=DM_PER_S)] = 0
    """0: as fast as it can."""
    camera_angle: Annotated[int, U8(mk="CamAngle", unit=DEG)] = 0
    """255: automatic, at a point of interest."""
    name: Annotated[str, Text(mk="Name", length=4)] = ""


class _Point027(_PointNamed):
    reserved: Annotated[tuple[int, ...], U8(mk="reserve", count=2)] = (0, 0)


class _Point2x(_PointNamed):
    photo_distance: Annotated[int, U8(mk="AutoPhotoDistance", unit=METRE)] = 0
    """Distance between two pictures; 0 for none."""
    reserved: Annotated[int, U8(mk="reserve")] = 0


class _ReadBack(WireMessage):
    count: Annotated[int, U8(mk="PointCount")]
    """Points stored, points of interest included."""
    number: Annotated[int, U8(mk="Index")]
    """The one asked for."""


@request(Board.NC, "s", name="SendTarget", layout="024", firmware=_024, source=Source.NC_RECEIVE, danger=_TARGET_DANGER)
class SendTarget024(_Point024):
    """Set the target; no answer but a beep."""


@request(Board.NC, "s", name="SendTarget", layout="027", firmware=_027, source=Source.TOOLS, danger=_TARGET_DANGER)
class SendTarget027(_Point027):
    """Set the target; no answer but a beep."""


@request(
    Board.NC,
    "s",
    name="SendTarget",
    layout="2x",
    firmware=_2X,
    source=(Source.WIKI, Source.UGCS),
    danger=_TARGET_DANGER,
)
class SendTarget2x(_Point2x):
    """Set the target; no answer but a beep."""


@request(Board.NC, "s", name="SendTarget", layout="old", firmware=_OLD, source=Source.TOOLS, danger=_TARGET_DANGER)
class SendTargetOld(_PointOld):
    """Set the target; no answer but a beep."""


@request(
    Board.NC,
    "w",
    name="WriteWaypoint",
    layout="024",
    reply="W",
    firmware=_024,
    source=Source.NC_RECEIVE,
    policy=Policy(0.5, 3),
    matches=same("index", also=0),
    danger=_WRITE_DANGER,
)
class WriteWaypoint024(_Point024):
    """Store a point of the route."""


@request(
    Board.NC,
    "w",
    name="WriteWaypoint",
    layout="027",
    reply="W",
    firmware=_027,
    source=Source.TOOLS,
    policy=Policy(0.5, 3),
    matches=same("index", also=0),
    danger=_WRITE_DANGER,
)
class WriteWaypoint027(_Point027):
    """Store a point of the route."""


@request(
    Board.NC,
    "w",
    name="WriteWaypoint",
    layout="2x",
    reply="W",
    firmware=_2X,
    source=(Source.WIKI, Source.UGCS),
    policy=Policy(0.5, 3),
    matches=same("index", also=0),
    danger=_WRITE_DANGER,
)
class WriteWaypoint2x(_Point2x):
    """Store a point of the route."""


@request(
    Board.NC,
    "w",
    name="WriteWaypoint",
    layout="old",
    reply="W",
    firmware=_OLD,
    source=Source.TOOLS,
    policy=Policy(0.5, 3),
    matches=same("index", also=0),
    danger=_WRITE_DANGER,
)
class WriteWaypointOld(_PointOld):
    """Store a point of the route."""


@answer(Board.NC, "W", firmware="NC", source=Source.NC_SEND)
class WaypointWritten(WireMessage):
    """Result of storing a point."""

    index: Annotated[int, U8(mk="Index")]
    """The stored one; 0 means cleared AND refused: only the list's state tells them apart."""


@request(
    Board.NC,
    "x",
    reply="X",
    firmware="NC",
    source=Source.NC_RECEIVE,
    policy=Policy(0.4, 4),
    matches=same("index", "number"),
)
class WaypointRequest(WireMessage):
    """Ask for a stored point."""

    index: Annotated[int, U8(mk="Index", low=1)]
    """1..; 0 gets no answer, above the count only the count."""


@answer(Board.NC, "X", name="Waypoint", layout="024", firmware=_024, source=Source.NC_SEND)
class Waypoint024(_Point024, _ReadBack):
    """A stored point."""


@answer(Board.NC, "X", name="Waypoint", layout="027", firmware=_027, source=Source.TOOLS)
class Waypoint027(_Point027, _ReadBack):
    """A stored point."""


@answer(Board.NC, "X", name="Waypoint", layout="2x", firmware=_2X, source=(Source.WIKI, Source.UGCS))
class Waypoint2x(_Point2x, _ReadBack):
    """A stored point."""


@answer(Board.NC, "X", layout="count", firmware="NC", source=Source.NC_SEND)
class WaypointCount(WireMessage):
    """The answer when there is no such point."""

    count: Annotated[int, U8(mk="PointCount")]
    """Points stored, points of interest included."""
