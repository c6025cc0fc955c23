"""Parameter sets and mixer of the FlightCtrl, as they cross the line; what the bytes mean is `protocol.settings`.

Source: docs/protocol.md, "FlightCtrl commands"; firmware notes 7.
"""

from __future__ import annotations

from typing import Annotated, Final

from mkdaemon.protocol.fields import S8, U8, Rest, Text
from mkdaemon.protocol.units import MIX
from mkdaemon.protocol.wire import Board, Direction, WireMessage, message

ACTIVE_SET: Final = 255
"""Index that asks for the set in use."""

_SHORTEST: Final = 88
"""Bytes of a parameter set of revision 73."""
_LONGEST: Final = 178
"""Bytes of a parameter set of revision 108 and later."""


def _is_reset(payload: bytes) -> bool:
    return 10 <= payload[0] <= 29


def _is_request(payload: bytes) -> bool:
    return not _is_reset(payload)


@message(
    Board.FC,
    "q",
    key="settings_request",
    direction=Direction.TO_BOARD,
    reply="Q",
    source="WIRE 7, SettingsRequest",
    firmware="FC",
    danger="a set that is not active is loaded into the live parameters",
    recognise=_is_request,
)
class SettingsRequest(WireMessage):
    """Ask for a parameter set."""

    index: Annotated[int, U8("Index", only=frozenset({1, 2, 3, 4, 5, ACTIVE_SET}))]
    """1..5, or 255 for the active set (the only one that changes nothing)."""


@message(
    Board.FC,
    "q",
    key="settings_reset",
    layout="reset",
    direction=Direction.TO_BOARD,
    reply="Q",
    source="WIRE 7, SettingsRequest",
    firmware="FC",
    danger="resets a parameter set to defaults, stores it and makes it active",
    recognise=_is_reset,
)
class SettingsReset(WireMessage):
    """Reset a parameter set to its defaults."""

    index: Annotated[int, U8("Index", only=frozenset({11, 12, 13, 14, 15, 21, 22, 23, 24, 25}))]
    """10 + set: keep the channels; 20 + set: reset them too."""


@message(
    Board.FC,
    "Q",
    key="settings",
    direction=Direction.FROM_BOARD,
    source="WIRE 7, 16",
    firmware="FC",
)
class Settings(WireMessage):
    """A parameter set; its layout is that of the revision in its first byte."""

    index: Annotated[int, U8("Index")]
    parameters: Annotated[bytes, Rest("ParamSet", _SHORTEST, _LONGEST)]


@message(
    Board.FC,
    "s",
    key="write_settings",
    direction=Direction.TO_BOARD,
    reply="S",
    source="WIRE 7, 16",
    firmware="FC",
    danger="overwrites a parameter set and activates it",
)
class WriteSettings(WireMessage):
    """Store a parameter set and activate it; refused with motors running or on another revision."""

    index: Annotated[int, U8("Index", low=1, high=5)]
    parameters: Annotated[bytes, Rest("ParamSet", _SHORTEST, _LONGEST)]


@message(
    Board.FC,
    "S",
    key="settings_written",
    direction=Direction.FROM_BOARD,
    source="WIRE 7, SettingNumberReply",
    firmware="FC",
)
class SettingsWritten(WireMessage):
    """How storing a parameter set ended."""

    index: Annotated[int, U8("Index")]
    """The active set; 0: refused."""


@message(
    Board.FC,
    "f",
    key="select_settings",
    direction=Direction.TO_BOARD,
    reply="F",
    source="WIRE 7, ChangeSetting",
    firmware="FC 0.77a and later",
    danger="switches the live parameters; silence while motors run",
    since=(0, 77),
)
class SelectSettings(WireMessage):
    """Load a stored parameter set into the live parameters."""

    index: Annotated[int, U8("Index", low=1, high=5)]


@message(
    Board.FC,
    "F",
    key="settings_selected",
    direction=Direction.FROM_BOARD,
    source="WIRE 7, SettingNumberReply",
    firmware="FC 0.77a and later",
)
class SettingsSelected(WireMessage):
    """A parameter set was loaded."""

    index: Annotated[int, U8("Index")]
    """The set stored as active (on 2.x not the one loaded)."""


class _MixerTable(WireMessage):
    revision: Annotated[int, U8("Revision", low=1, high=1)] = 1
    name: Annotated[str, Text("Name", 12)]
    motors: Annotated[tuple[int, ...], S8("Motor", MIX, count=64)]
    """16 rows of throttle, pitch, roll, yaw."""


@message(
    Board.FC,
    "n",
    key="mixer_request",
    direction=Direction.TO_BOARD,
    reply="N",
    source="WIRE 7",
    firmware="FC 0.73 and later",
    since=(0, 73),
)
class MixerRequest(WireMessage):
    """Ask for the mixer."""


@message(
    Board.FC,
    "N",
    key="mixer",
    direction=Direction.FROM_BOARD,
    source="WIRE 7, MixerTable",
    firmware="FC 0.73 and later",
)
class Mixer(_MixerTable):
    """How throttle and sticks drive each motor."""


@message(
    Board.FC,
    "m",
    key="write_mixer",
    direction=Direction.TO_BOARD,
    reply="M",
    source="WIRE 7, MixerTable",
    firmware="FC 0.73 and later",
    danger="overwrites the mixer at once, in flight too",
    since=(0, 73),
)
class WriteMixer(_MixerTable):
    """Store a mixer and use it."""


@message(
    Board.FC,
    "M",
    key="mixer_written",
    direction=Direction.FROM_BOARD,
    source="WIRE 7, MixerWriteReply",
    firmware="FC 0.73 and later",
)
class MixerWritten(WireMessage):
    """How storing a mixer ended."""

    stored: Annotated[int, U8("Ack")]
    """1 stored, 0 wrong revision."""
