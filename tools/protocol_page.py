"""The tables of docs/protocol.md, made from those of messages, settings and compatibility."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby
from types import ModuleType
from typing import Final

from lab.places import CAPTURES
from mkdaemon.described import meanings_of
from mkdaemon.protocol.layout import Slot
from mkdaemon.protocol.messages import (
    blctrl,
    control,
    display,
    flightctrl,
    linktest,
    mk3mag,
    navictrl,
    osd,
    osdsets,
    parameters,
    streams,
    version,
    waypoints,
)
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, MessageSpec, WireMessage
from tools.coverage_table import coverage, shown_releases
from tools.markdown import escape, table
from tools.protocol_tables import (
    compatibility_tables,
    danger_table,
    error_table,
    flag_tables,
    parameter_tables,
    revision_table,
)


def messages(modules: Sequence[ModuleType], _: None) -> Iterator[str]:
    """The messages that some modules declare, each with its layouts."""
    yield from (_first_paragraph(module) + "\n" for module in modules)
    classes = dict.fromkeys(cls for cls in MESSAGES.values() if inspect.getmodule(cls) in modules)
    for _key, layouts in groupby(classes, key=lambda cls: (cls.spec.id, cls.spec.name, cls.spec.boards[0])):
        yield from _message(list(layouts))


def _first_paragraph(module: ModuleType) -> str:
    return " ".join(escape(line) for line in inspect.cleandoc(module.__doc__ or "").split("\n\n")[0].splitlines())


def _message(layouts: list[type[WireMessage]]) -> Iterator[str]:
    first = layouts[0]
    spec = first.spec
    boards = ", ".join(dict.fromkeys(board.word for cls in layouts for board in cls.spec.boards))
    yield f"### {spec.name} (`{spec.id}`, {boards})"
    yield ""
    yield inspect.cleandoc(first.__doc__ or "")
    yield ""
    if spec.direction is Direction.TO_BOARD:
        reply = f"answer `{spec.reply}`" if spec.reply else "no answer"
        anyone = ", obeyed whatever the address" if spec.any_address else ""
        yield f"`{spec.id}` to {boards}{anyone}; {reply}."
        name = spec.key.replace("_", "-")
        yield f"Key `cmd/{spec.boards[0].word}/{spec.key}`, command line `mkctl board send {name}`."
        yield _asking(spec)
        dangers = dict.fromkeys(cls.spec.danger.effect for cls in layouts if cls.spec.danger)
        yield from (f"**Danger**: {danger}." for danger in dangers)
    else:
        yield f"`{spec.id}` from {boards}. Key `rx/{spec.boards[0].word}/{spec.key}`."
    yield ""
    for cls in layouts:
        yield from _layout(cls, alone=len(layouts) == 1)


def _asking(spec: MessageSpec) -> str:
    """How it is asked: time-outs and retries of each board, what it starts, who passes it on."""
    words = []
    for board in spec.boards:
        policy = spec.policy(board)
        wait = f"{policy.timeout:g} s and {policy.retries} retries" if spec.reply else "none"
        deaf = f", deaf for {policy.deaf:g} s" if policy.deaf else ""
        words.append(f"{board.word} {wait}{deaf}")
    text = f"Time-out: {'; '.join(words)}."
    if spec.stream is not None:
        text += f" Starts the stream `{spec.stream.key}`."
    if spec.is_forwarded:
        text += " A NaviCtrl passes it on to the FlightCtrl."
    return text


def _layout(cls: type[WireMessage], *, alone: bool) -> Iterator[str]:
    spec = cls.spec
    longest = f" to {spec.longest}" if spec.longest else " or more" if spec.open_ended else ""
    name = "" if alone and spec.layout == "1" else f"Layout `{spec.layout}`: "
    yield f"{name}{spec.size}{longest} bytes; {spec.firmware}. Source: {', '.join(spec.sources)}."
    yield ""
    if spec.slots:
        yield from table(
            ("offset", "type", "field", "firmware", "unit", "SI", "sent", "meaning"),
            (_field(cls, slot) for slot in spec.slots),
        )
        yield ""


def _field(cls: type[WireMessage], slot: Slot) -> tuple[str, ...]:
    wire = slot.wire
    meaning = meanings_of(cls)[slot.name].replace("\n", " ")
    if wire.enum is not None:
        meaning = f"{meaning} [{wire.enum.__name__}](#{wire.enum.__name__.lower()})".strip()
    scale = "" if wire.scale is None else f"{_number(wire.scale)} {wire.si}"
    if wire.zero:
        scale = f"(value - {wire.zero}) × {scale}"
    sent = ", ".join(str(value) for value in sorted(wire.only))
    if not sent and not (wire.is_text or wire.is_bytes):
        sent = f"{wire.minimum}..{wire.maximum}"
    if cls.spec.direction is Direction.FROM_BOARD:
        sent = ""
    return str(slot.offset), wire.type_name, f"`{slot.name}`", wire.mk, wire.unit, scale, sent, meaning


def _number(value: float) -> str:
    degrees = value * 180.0 / math.pi
    if abs(value) < 1 and abs(degrees - round(degrees, 3)) < 1e-9 and round(degrees, 3) != 0:
        return f"{round(degrees, 3):g}π/180"
    return f"{value:g}"


def _coverage(_: None) -> Iterator[str]:
    for board, name in ((Board.FC, "FlightCtrl"), (Board.NC, "NaviCtrl")):
        rows = ((f"`{row.letter}`", row.name, *row.cells) for row in coverage(board, CAPTURES))
        yield from table((name, "message", *shown_releases(board)), rows)
        yield ""


TABLES: Final[Mapping[str, Callable[[None], Iterator[str]]]] = {
    "versioninfo": partial(messages, (version,)),
    "common_commands": partial(messages, (streams, display)),
    "externalcontrol": partial(messages, (control,)),
    "flightctrl_commands": partial(messages, (flightctrl, parameters)),
    "bl_ctrl": partial(messages, (blctrl,)),
    "navictrl_commands": partial(messages, (linktest, navictrl)),
    "navidata": partial(messages, (osd, osdsets)),
    "points": partial(messages, (waypoints,)),
    "mk3mag": partial(messages, (mk3mag,)),
    "dangers": danger_table,
    "flags": flag_tables,
    "errors": error_table,
    "generations": compatibility_tables,
    "revisions": revision_table,
    "parameters": parameter_tables,
    "coverage": _coverage,
}
"""By the names that the page gives them."""
