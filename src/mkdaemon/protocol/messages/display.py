"""A board's display: its 4 x 20 menu and the labels of its debug channels.

Source: docs/protocol.md, "Common commands".
"""

from __future__ import annotations

from typing import Annotated, Any, Final

from mkdaemon.protocol.fields import U8, Text
from mkdaemon.protocol.matching import same
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy, StreamSpec
from mkdaemon.protocol.units import TEN_MS
from mkdaemon.protocol.wire import Board, WireMessage, answer, request
from mkdaemon.telemetry.danger import Confirm, Danger

ALL_KEYS_UP: Final = 0xFF
"""`DisplayRequest.keys_inverted` with no key pressed."""

_PILOTS = (Board.FC, Board.NC)
_ALL = (Board.FC, Board.NC, Board.MAG)


def _fits_page(asked: Any, came: Any) -> bool:
    """Whether a page of the menu answers a request: a page that does not exist is answered by the first or the last."""
    return came.page == asked.page or (asked.page > came.last_page and came.page in (0, came.last_page))


@request(
    _PILOTS,
    "h",
    reply="H",
    firmware="FC 0.7x and later, NC",
    source=(Source.FC_RECEIVE, Source.NC_RECEIVE),
    stream=StreamSpec("display"),
    danger=Danger(
        effect="with keys: some pages change trim or calibration",
        confirm=Confirm.IN_FLIGHT,
        harmless=("keys_inverted", ALL_KEYS_UP),
    ),
    any_address=True,
)
class DisplayRequest(WireMessage):
    """Press keys of the menu, and stream it: once now, then every interval for 4 s."""

    keys_inverted: Annotated[int, U8(mk="KeysInverted", low=0x80)] = ALL_KEYS_UP
    """Ones complement of `MenuKey`; 0xFF presses none; bit 7 stays 1 (clear asks for the obsolete line format)."""
    interval: Annotated[int, U8(mk="Interval", unit=TEN_MS)] = 0
    """0: one answer only."""


@answer(_PILOTS, "H", firmware="FC 0.7x and later, NC", source=(Source.FC_SEND, Source.NC_SEND))
class Display(WireMessage):
    """The menu: 4 lines of 20 characters."""

    text: Annotated[str, Text(mk="Text", length=80, trim=False)]


@answer(_PILOTS, "H", name="Display", layout="old", firmware="obsolete", source=Source.FC_SEND)
class DisplayOld(WireMessage):
    """One line of the menu."""

    line: Annotated[int, U8(mk="Line")]
    text: Annotated[str, Text(mk="Text", length=20, trim=False)]


@request(
    _PILOTS,
    "l",
    reply="L",
    firmware="FC, NC",
    source=(Source.FC_RECEIVE, Source.NC_RECEIVE),
    policy={Board.NC: Policy(0.4, 4)},
    matches=_fits_page,
    any_address=True,
)
class MenuRequest(WireMessage):
    """Ask for one page of the menu."""

    page: Annotated[int, U8(mk="MenuItem")]
    """0..last page (19 on FC 2.12a, 15 on NC 0.24); a number above it is answered with page 0 or the last."""


@answer(_PILOTS, "L", firmware="FC, NC", source=(Source.FC_SEND, Source.NC_SEND))
class Menu(WireMessage):
    """One page of the menu: 4 lines of 20 characters."""

    page: Annotated[int, U8(mk="MenuItem")]
    last_page: Annotated[int, U8(mk="MaxMenuItem")]
    """Changes at run time."""
    text: Annotated[str, Text(mk="Text", length=80, trim=False)]


@request(
    _ALL,
    "a",
    reply="A",
    firmware="all",
    source=(Source.FC_RECEIVE, Source.NC_RECEIVE),
    policy={Board.FC: Policy(0.15, 4), Board.NC: Policy(0.3, 5)},
    matches=same("index"),
    any_address=True,
)
class LabelRequest(WireMessage):
    """Ask for the name of one debug channel."""

    index: Annotated[int, U8(mk="Index", high=31)]
    """0..31; the board clamps."""


@answer(_ALL, "A", firmware="all", source=(Source.FC_SEND, Source.NC_SEND))
class Label(WireMessage):
    """The name of one debug channel, often with its unit in brackets."""

    index: Annotated[int, U8(mk="Index")]
    text: Annotated[str, Text(mk="Label", length=16, pad=" ")]
