"""The tables of docs/protocol.md, made from those of messages, settings and compatibility."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum, IntFlag
from functools import partial
from itertools import groupby
from types import ModuleType
from typing import Final

from lab.places import CAPTURES
from mkdaemon.described import meanings_of
from mkdaemon.protocol import flags
from mkdaemon.protocol.errorcodes import ErrorCode, describe_error, error_since
from mkdaemon.protocol.generations import FC_GENERATIONS, NC_GENERATIONS
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
from mkdaemon.protocol.settings import known_revisions, layout_of
from mkdaemon.protocol.settings_fields import ParameterKind
from mkdaemon.protocol.settings_table import PARAMETERS, REVISIONS
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, MessageSpec, WireMessage
from mkdaemon.telemetry.danger import Confirm, Danger
from tools.coverage_table import coverage, shown_releases
from tools.markdown import escape, table


def danger_table(_: None) -> Iterator[str]:
    """What each dangerous request must meet."""
    found = {
        (f"`{cls.spec.id}`", cls.spec.boards[0].word, cls.spec.name, cls.spec.danger.effect, *_rule(cls.spec.danger))
        for cls in MESSAGES.values()
        if cls.spec.danger
    }
    return table(("id", "board", "message", "effect", "must meet", "harmless with"), sorted(found))


def _rule(danger: Danger) -> tuple[str, str]:
    """What it must meet, and the value with which it does no harm."""
    harmless = ""
    if danger.harmless is not None:
        name, value = danger.harmless
        harmless = f"{name} all 0" if isinstance(value, tuple) else f"{name} {value}"
    if danger.never:
        return f"never sent for a client: {danger.never}", harmless
    terms = []
    if danger.switch is not None:
        terms.append(f"`commands.{danger.switch}`")
    if danger.stopped:
        terms.append("motors stopped")
    if danger.proven:
        terms.append("board proven")
    if danger.confirm is Confirm.ALWAYS:
        terms.append("`confirm`")
    elif danger.confirm is Confirm.IN_FLIGHT:
        terms.append("`confirm` unless motors are known to stand still")
    return ", ".join(terms), harmless


def flag_tables(_: None) -> Iterator[str]:
    """Flags and enumerations, every member."""
    kinds = [item for item in vars(flags).values() if inspect.isclass(item) and item.__module__ == flags.__name__]
    for kind in (kind for kind in kinds if issubclass(kind, Enum)):
        yield f"### {kind.__name__}\n\n{inspect.cleandoc(kind.__doc__ or '')}\n"
        yield ", ".join(_member(kind, member) for member in kind) + "\n"


def _member(kind: type[Enum], member: Enum) -> str:
    is_flag = issubclass(kind, IntFlag)
    return f"`{int(member.value):#04x}` {member.name}" if is_flag else f"{member.value} {member.name}"


def error_table(_: None) -> Iterator[str]:
    """Error codes of the NaviCtrl."""
    rows = ((str(int(code)), code.name, describe_error(code), error_since(code)) for code in ErrorCode)
    return table(("code", "name", "meaning", "since"), rows)


def compatibility_tables(_: None) -> Iterator[str]:
    """Which release speaks how."""
    yield from table(
        ("FlightCtrl", "settings revisions", "b", "P", "C", "holds the last b", "stick filter", "R in flight"),
        (
            (
                _releases(row.since, row.until),
                _span(row.revisions),
                row.control or "read back (g) to know",
                row.receiver or "by length",
                row.attitude,
                row.dead_man.value,
                "yes" if row.stick_filter else "no",
                "obeyed" if row.resets_in_flight else "ignored",
            )
            for row in FC_GENERATIONS
        ),
    )
    yield ""
    yield from table(
        ("NaviCtrl", "points", "C", "data sets 10..16", "b"),
        (
            (
                _releases(row.since, row.until),
                row.point,
                row.attitude,
                "yes" if row.has_sets else "no",
                "taken" if row.takes_control else "forwarded to the FlightCtrl, unconfirmed",
            )
            for row in NC_GENERATIONS
        ),
    )


def _releases(since: tuple[int, int], until: tuple[int, int]) -> str:
    return f"{since[0]}.{since[1]:02d} to {until[0]}.{until[1]:02d}" if since != until else f"{since[0]}.{since[1]:02d}"


def _span(numbers: Iterable[int]) -> str:
    known = sorted(numbers)
    return str(known[0]) if len(known) == 1 else f"{known[0]}..{known[-1]}"


def revision_table(_: None) -> Iterator[str]:
    """Sizes of parameter sets."""
    layouts = ((number, layout_of(number)) for number in known_revisions())
    rows = ((str(number), str(layout.size), layout.firmware) for number, layout in layouts if layout)
    return table(("revision", "bytes", "firmware"), rows)


def parameter_tables(_: None) -> Iterator[str]:
    """Parameters of all revisions, and the bits of each."""
    last = max(REVISIONS)
    rows = (
        (
            f"`{item.name}`",
            item.mk,
            f"{item.since}..{item.until if item.until < 255 else ''}",
            " then ".join(f"{count} from {first}" for first, count in item.lengths) or "1",
            item.kind.value + ("" if item.high == 255 else f", to {item.high}"),
            item.unit,
            item.meaning,
        )
        for item in PARAMETERS
    )
    yield from table(("parameter", "firmware", "revisions", "bytes", "kind", "unit", "meaning"), rows)
    yield ""
    for item in PARAMETERS:
        if item.kind is ParameterKind.BITS:
            bits = (
                f"`{bit.mask:#04x}` {bit.name} ({bit.mk}{_bit_span(bit.since, bit.until, last)})" for bit in item.bits
            )
            yield f"`{item.name}`: " + ", ".join(bits)
            yield ""


def _bit_span(since: int, until: int, last: int) -> str:
    if since == 0 and until >= last:
        return ""
    return f"; {since or ''}..{until if until < last else ''}"


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
