"""MK3Mag compass: what a FlightCtrl sends it. A host overhears it on FlightCtrl ports and never sends it.

Source: docs/protocol.md, "MK3Mag".
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import S16, U8
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.units import DECI_DEG
from mkdaemon.protocol.wire import Board, WireMessage, request
from mkdaemon.telemetry.danger import Confirm, Danger, Switch

_DANGER = Danger(
    effect="drives the compass calibration: can corrupt it",
    confirm=Confirm.ALWAYS,
    stopped=True,
    proven=True,
    switch=Switch.COMPASS_CALIBRATION,
)


class _Feed(WireMessage):
    pitch: Annotated[int, S16(mk="AngleNick", unit=DECI_DEG)]
    """Positive: nose down."""
    roll: Annotated[int, S16(mk="AngleRoll", unit=-DECI_DEG)]
    """Positive on the wire: LEFT side down."""
    user_parameter_1: Annotated[int, U8(mk="UserParam[0]")]
    user_parameter_2: Annotated[int, U8(mk="UserParam[1]")]
    calibration_step: Annotated[int, U8(mk="CalState")]
    """0 idle, 1..5 steps of the calibration."""
    orientation: Annotated[int, U8(mk="Orientation")]
    """1 on FC 0.9x and later: a hint on how it is mounted."""


@request(Board.MAG, "k", layout="k", reply="K", firmware="FC 2.x", source=Source.FC_SEND, danger=_DANGER)
class CompassFeed(_Feed):
    """Attitude for tilt compensation, every 99 ms (999 ms with a NaviCtrl)."""


@request(
    Board.MAG,
    "w",
    name="CompassFeed",
    layout="w",
    reply="K",
    firmware="FC 0.7x and 0.8x",
    source=Source.FC_SEND,
    danger=_DANGER,
)
class CompassFeedOld(_Feed):
    """Attitude for tilt compensation, every 99 ms (999 ms with a NaviCtrl)."""
