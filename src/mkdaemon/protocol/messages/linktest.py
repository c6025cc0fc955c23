"""Link test and error text of the NaviCtrl.

Source: docs/protocol.md, "NaviCtrl commands".
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import U16, Text
from mkdaemon.protocol.wire import Board, Direction, WireMessage, message


@message(
    Board.NC,
    "z",
    key="echo_request",
    direction=Direction.TO_BOARD,
    reply="Z",
    source="WIRE 8, Echo",
    firmware="NC",
)
class EchoRequest(WireMessage):
    """Ask for a pattern back; does not feed the NaviCtrl's serial-link watchdog."""

    pattern: Annotated[int, U16("Pattern")]


@message(
    Board.NC,
    "Z",
    key="echo",
    direction=Direction.FROM_BOARD,
    source="WIRE 8, Echo",
    firmware="NC",
)
class Echo(WireMessage):
    """The pattern, unchanged."""

    pattern: Annotated[int, U16("Pattern")]


@message(
    Board.NC,
    "e",
    key="error_text_request",
    direction=Direction.TO_BOARD,
    reply="E",
    source="WIRE 8",
    firmware="NC",
)
class ErrorTextRequest(WireMessage):
    """Ask for the current error in words."""


@message(
    Board.NC,
    "E",
    key="error_text",
    direction=Direction.FROM_BOARD,
    source="WIRE 8, ErrorText",
    firmware="NC",
)
class ErrorText(WireMessage):
    """The current error in words; they vary between releases, codes do not."""

    text: Annotated[str, Text("Text", 25)]
    """Everything from the first NUL on is stale and taken off."""
