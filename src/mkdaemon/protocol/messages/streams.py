"""Streams every pilot board offers: debug channels and attitude. They end 4 s after the last request.

Source: docs/protocol.md, "Common commands"; docs/firmware-notes.md, section 5.
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import S8, S16, U8, U16
from mkdaemon.protocol.flags import BoardStatus
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import StreamSpec
from mkdaemon.protocol.units import DECI_DEG, STICK, TEN_MS
from mkdaemon.protocol.wire import Board, WireMessage, answer, request


@request(
    (Board.FC, Board.NC, Board.MAG),
    "d",
    reply="D",
    firmware="all",
    source=(Source.FC_RECEIVE, Source.NC_RECEIVE),
    stream=StreamSpec("debug", renews=3),
    any_address=True,
)
class DebugRequest(WireMessage):
    """Stream the debug channels; the first frame comes at once."""

    interval: Annotated[int, U8(mk="Interval", unit=TEN_MS)]
    """0 stops; 1 starves everything else on an FC."""


class _Debug(WireMessage):
    status_green: Annotated[BoardStatus, U8(mk="StatusGreen", enum=BoardStatus)]
    """Boards present."""
    status_red: Annotated[BoardStatus, U8(mk="StatusRed", enum=BoardStatus)]
    """Boards in error."""


@answer(
    (Board.FC, Board.MAG), "D", name="DebugData", key="debug", layout="fc", firmware="FC, MK3Mag", source=Source.FC_SEND
)
class DebugDataFc(_Debug):
    """32 debug channels; their labels tell meaning and unit."""

    analog: Annotated[tuple[int, ...], S16(mk="Analog", count=32)]


@answer(Board.NC, "D", name="DebugData", key="debug", layout="nc", firmware="NC", source=Source.NC_SEND)
class DebugDataNc(_Debug):
    """32 debug channels; declared unsigned in the NC's source, but many are signed, so they are read as signed."""

    analog: Annotated[tuple[int, ...], S16(mk="Analog", count=32)]


@request(
    (Board.FC, Board.NC),
    "c",
    reply="C",
    firmware="FC 0.72o and later, NC",
    since=(0, 18),
    source=(Source.FC_RECEIVE, Source.NC_RECEIVE),
    stream=StreamSpec("attitude", renews=1, is_vital=True),
    any_address=True,
)
class AttitudeRequest(WireMessage):
    """Stream the attitude; an FC sends the first frame after one interval."""

    interval: Annotated[int, U8(mk="Interval", unit=TEN_MS)]
    """0 stops."""


class _Attitude(WireMessage):
    pitch: Annotated[int, S16(mk="AngleNick", unit=DECI_DEG)]
    """Positive: nose down."""
    roll: Annotated[int, S16(mk="AngleRoll", unit=-DECI_DEG)]
    """Positive on the wire: LEFT side down."""
    heading: Annotated[int, S16(mk="Heading", unit=DECI_DEG)]
    """Gyro compass, clockwise from magnetic north."""


class _FcAttitude(_Attitude):
    centroid: Annotated[tuple[int, ...], S8(mk="Centroid", count=3)]
    """Integrals of pitch, roll, yaw, shifted right by 9."""


@answer(
    Board.FC,
    "C",
    name="AttitudeData",
    key="attitude",
    layout="fc210",
    firmware="FC 2.09 and later",
    source=Source.FC_SEND,
)
class AttitudeDataFc210(_FcAttitude):
    """Attitude of the FlightCtrl."""

    accelerometer_z: Annotated[int, U16(mk="AccZ", unit="raw")]
    reserved: Annotated[tuple[int, ...], S8(mk="reserve", count=3)]


@answer(
    Board.FC,
    "C",
    name="AttitudeData",
    key="attitude",
    layout="fc_old",
    firmware="FC 0.72o to 2.08",
    source=Source.FC_SEND,
)
class AttitudeDataFcOld(_FcAttitude):
    """Attitude of the FlightCtrl."""

    reserved: Annotated[tuple[int, ...], S8(mk="reserve", count=5)]


@answer(Board.NC, "C", name="AttitudeData", key="attitude", layout="nc", firmware="NC 0.2x", source=Source.NC_SEND)
class AttitudeDataNc(_Attitude):
    """Attitude of the FlightCtrl as the NaviCtrl knows it."""

    reserved: Annotated[tuple[int, ...], U8(mk="reserve", count=8)]


@answer(
    Board.NC,
    "C",
    name="AttitudeData",
    key="attitude",
    layout="nc_sticks",
    firmware="NC 0.28 and later (about)",
    source=Source.TOOLS,
)
class AttitudeDataNcSticks(_Attitude):
    """Attitude of the FlightCtrl as the NaviCtrl knows it, with the pilot's sticks."""

    stick_pitch: Annotated[int, U8(mk="StickNick", unit=STICK)]
    stick_roll: Annotated[int, U8(mk="StickRoll", unit=-STICK)]
    stick_yaw: Annotated[int, U8(mk="StickYaw", unit=STICK)]
    stick_throttle: Annotated[int, U8(mk="StickGas", unit=STICK)]
    reserved: Annotated[tuple[int, ...], U8(mk="reserve", count=4)]
