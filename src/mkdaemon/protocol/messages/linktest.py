"""Link test and error text of the NaviCtrl.

Source: docs/protocol.md, "NaviCtrl commands".
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import U16, Text
from mkdaemon.protocol.matching import same
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.wire import Board, WireMessage, answer, request


@request(
    Board.NC, "z", reply="Z", firmware="NC", source=Source.NC_RECEIVE, policy=Policy(0.15, 0), matches=same("pattern")
)
class EchoRequest(WireMessage):
    """Ask for a pattern back; does not feed the NaviCtrl's serial-link watchdog."""

    pattern: Annotated[int, U16(mk="Pattern")]
    """Any number; it comes back."""


@answer(Board.NC, "Z", firmware="NC", source=Source.NC_SEND)
class Echo(WireMessage):
    """The pattern, unchanged."""

    pattern: Annotated[int, U16(mk="Pattern")]
    """Any number; it comes back."""


@request(Board.NC, "e", reply="E", firmware="NC", source=Source.NC_RECEIVE, policy=Policy(0.4, 4))
class ErrorTextRequest(WireMessage):
    """Ask for the current error in words."""


@answer(Board.NC, "E", firmware="NC", source=Source.NC_SEND)
class ErrorText(WireMessage):
    """The current error in words; they vary between releases, codes do not."""

    text: Annotated[str, Text(mk="Text", length=25)]
    """Everything from the first NUL on is stale and taken off."""
