"""What a board shows a person: its 4 x 20 menu and the labels of its debug channels.

Source: docs/protocol.md, "Common commands".
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import U8, Text
from mkdaemon.protocol.units import TEN_MS
from mkdaemon.protocol.wire import Board, Direction, WireMessage, message

_PILOTS = (Board.FC, Board.NC)
_ALL = (Board.FC, Board.NC, Board.MAG)


@message(
    _PILOTS,
    "h",
    key="display_request",
    direction=Direction.TO_BOARD,
    reply="H",
    source="WIRE 5, DisplayRequest",
    firmware="FC 0.7x and later, NC",
    danger="with keys: some pages change trim or calibration",
    any_address=True,
)
class DisplayRequest(WireMessage):
    """Press keys of the menu, and stream it: once now, then every interval for 4 s."""

    keys_inverted: Annotated[int, U8("KeysInverted", low=0x80)] = 0xFF
    """Ones complement of `MenuKey`; 0xFF presses none; bit 7 stays 1 (clear asks for the obsolete line format)."""
    interval: Annotated[int, U8("Interval", TEN_MS)] = 0
    """0: one answer only."""


@message(
    _PILOTS,
    "H",
    key="display",
    direction=Direction.FROM_BOARD,
    source="WIRE 5, DisplayReply",
    firmware="FC 0.7x and later, NC",
)
class Display(WireMessage):
    """The menu: 4 lines of 20 characters."""

    text: Annotated[str, Text("Text", 80, trim=False)]


@message(
    _PILOTS,
    "H",
    name="Display",
    key="display",
    layout="old",
    direction=Direction.FROM_BOARD,
    source="WIRE 15, DisplayReplyOld",
    firmware="obsolete",
)
class DisplayOld(WireMessage):
    """One line of the menu."""

    line: Annotated[int, U8("Line")]
    text: Annotated[str, Text("Text", 20, trim=False)]


@message(
    _PILOTS,
    "l",
    key="menu_request",
    direction=Direction.TO_BOARD,
    reply="L",
    source="WIRE 5, MenuRequest",
    firmware="FC, NC",
    any_address=True,
)
class MenuRequest(WireMessage):
    """Ask for one page of the menu."""

    page: Annotated[int, U8("MenuItem")]
    """0..last page (19 on FC 2.12a, 15 on NC 0.24)."""


@message(
    _PILOTS,
    "L",
    key="menu",
    direction=Direction.FROM_BOARD,
    source="WIRE 5, MenuReply",
    firmware="FC, NC",
)
class Menu(WireMessage):
    """One page of the menu: 4 lines of 20 characters."""

    page: Annotated[int, U8("MenuItem")]
    last_page: Annotated[int, U8("MaxMenuItem")]
    """Changes at run time."""
    text: Annotated[str, Text("Text", 80, trim=False)]


@message(
    _ALL,
    "a",
    key="label_request",
    direction=Direction.TO_BOARD,
    reply="A",
    source="WIRE 5",
    firmware="all",
    any_address=True,
)
class LabelRequest(WireMessage):
    """Ask for the name of one debug channel."""

    index: Annotated[int, U8("Index", high=31)]
    """0..31; the board clamps."""


@message(
    _ALL,
    "A",
    key="label",
    direction=Direction.FROM_BOARD,
    source="WIRE 5, AnalogLabel",
    firmware="all",
)
class Label(WireMessage):
    """The name of one debug channel, often with its unit in brackets."""

    index: Annotated[int, U8("Index")]
    text: Annotated[str, Text("Label", 16, pad=" ")]
