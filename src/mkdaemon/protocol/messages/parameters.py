"""Parameter sets and mixer of the FlightCtrl, as they cross the line; what the bytes mean is `protocol.settings`.

Source: docs/protocol.md, "FlightCtrl commands"; docs/firmware-notes.md, section 7.
"""

from __future__ import annotations

from typing import Annotated, Final

from mkdaemon.protocol.fields import S8, U8, Rest, Text
from mkdaemon.protocol.framing import padded_length
from mkdaemon.protocol.matching import same
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.units import MIX
from mkdaemon.protocol.wire import Board, WireMessage, answer, request
from mkdaemon.telemetry.danger import Confirm, Danger, Switch

ACTIVE_SET: Final = 255
"""`SettingsRequest.index` of the set in use, the only one whose reading changes nothing."""

_SHORTEST: Final = 88
"""Bytes of a parameter set of revision 73."""
_LONGEST: Final = padded_length(1 + 178) - 1
"""Bytes of a parameter set of revision 108 and later, as it is received after its index: padded."""


def _is_reset(payload: bytes) -> bool:
    return 10 <= payload[0] <= 29


def _is_request(payload: bytes) -> bool:
    return not _is_reset(payload)


@request(
    Board.FC,
    "q",
    reply="Q",
    firmware="FC",
    source=Source.FC_RECEIVE,
    policy=Policy(0.4, 4),
    matches=same("index", also=ACTIVE_SET),
    danger=Danger(
        effect="a set that is not active is loaded into the live parameters",
        confirm=Confirm.ALWAYS,
        stopped=True,
        proven=True,
        harmless=("index", ACTIVE_SET),
    ),
    recognise=_is_request,
)
class SettingsRequest(WireMessage):
    """Ask for a parameter set."""

    index: Annotated[int, U8(mk="Index", only=frozenset({1, 2, 3, 4, 5, ACTIVE_SET}))]
    """1..5, or 255 for the active set (the only one that changes nothing)."""


@request(
    Board.FC,
    "q",
    layout="reset",
    reply="Q",
    firmware="FC",
    source=Source.FC_RECEIVE,
    policy=Policy(1.5, 0, deaf=0.5),
    matches=lambda asked, came: came.index == asked.index % 10,
    danger=Danger(
        effect="resets a parameter set to defaults, stores it and makes it active",
        confirm=Confirm.ALWAYS,
        stopped=True,
        proven=True,
        switch=Switch.FACTORY_RESET,
    ),
    recognise=_is_reset,
)
class SettingsReset(WireMessage):
    """Reset a parameter set to its defaults."""

    index: Annotated[int, U8(mk="Index", only=frozenset({11, 12, 13, 14, 15, 21, 22, 23, 24, 25}))]
    """10 + set: keep the channels; 20 + set: reset them too."""


@answer(Board.FC, "Q", firmware="FC", source=Source.FC_SEND, tells_firmware=True)
class Settings(WireMessage):
    """A parameter set; its layout is that of the revision in its first byte."""

    index: Annotated[int, U8(mk="Index")]
    parameters: Annotated[bytes, Rest(mk="ParamSet", shortest=_SHORTEST, longest=_LONGEST)]
    """A whole set, from the revision byte to the name."""


@request(
    Board.FC,
    "s",
    reply="S",
    firmware="FC",
    source=Source.FC_RECEIVE,
    policy=Policy(2.5, 1, deaf=1.33),
    danger=Danger(
        effect="overwrites a parameter set and activates it", confirm=Confirm.ALWAYS, stopped=True, proven=True
    ),
)
class WriteSettings(WireMessage):
    """Store a parameter set and activate it; refused with motors running or on another revision."""

    index: Annotated[int, U8(mk="Index", low=1, high=5)]
    parameters: Annotated[bytes, Rest(mk="ParamSet", shortest=_SHORTEST, longest=_LONGEST)]
    """A whole set, from the revision byte to the name."""


@answer(Board.FC, "S", firmware="FC", source=Source.FC_SEND)
class SettingsWritten(WireMessage):
    """Result of storing a parameter set."""

    index: Annotated[int, U8(mk="Index")]
    """The active set; 0: refused."""


@request(
    Board.FC,
    "f",
    reply="F",
    firmware="FC 0.77a and later",
    since=(0, 77),
    source=Source.FC_RECEIVE,
    policy=Policy(1.5, 1, deaf=0.73),
    danger=Danger(
        effect="switches the live parameters; silence while motors run",
        confirm=Confirm.ALWAYS,
        stopped=True,
        proven=True,
    ),
)
class SelectSettings(WireMessage):
    """Load a stored parameter set into the live parameters."""

    index: Annotated[int, U8(mk="Index", low=1, high=5)]


@answer(Board.FC, "F", firmware="FC 0.77a and later", source=Source.FC_SEND)
class SettingsSelected(WireMessage):
    """A parameter set was loaded."""

    index: Annotated[int, U8(mk="Index")]
    """The set stored as active (on 2.x not the one loaded)."""


class _MixerTable(WireMessage):
    revision: Annotated[int, U8(mk="Revision", low=1, high=1)] = 1
    name: Annotated[str, Text(mk="Name", length=12)]
    motors: Annotated[tuple[int, ...], S8(mk="Motor", unit=MIX, count=64)]
    """16 rows of throttle, pitch, roll, yaw."""


@request(
    Board.FC,
    "n",
    reply="N",
    firmware="FC 0.73 and later",
    since=(0, 73),
    source=Source.FC_RECEIVE,
    policy=Policy(0.2, 3),
)
class MixerRequest(WireMessage):
    """Ask for the mixer."""


@answer(Board.FC, "N", firmware="FC 0.73 and later", source=Source.FC_SEND)
class Mixer(_MixerTable):
    """Shares of throttle and sticks for each motor."""


@request(
    Board.FC,
    "m",
    reply="M",
    firmware="FC 0.73 and later",
    since=(0, 73),
    source=Source.FC_RECEIVE,
    policy=Policy(1.0, 1, deaf=0.3),
    danger=Danger(
        effect="overwrites the mixer at once, in flight too", confirm=Confirm.ALWAYS, stopped=True, proven=True
    ),
)
class WriteMixer(_MixerTable):
    """Store a mixer and use it."""


@answer(Board.FC, "M", firmware="FC 0.73 and later", source=Source.FC_SEND)
class MixerWritten(WireMessage):
    """Result of storing a mixer."""

    stored: Annotated[int, U8(mk="Ack")]
    """1 stored, 0 wrong revision."""
