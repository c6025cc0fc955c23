"""The tables of docs/protocol.md that are not messages: dangers, flags, error codes, compatibility, parameter sets."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from enum import Enum, IntFlag

from mkdaemon.protocol import flags
from mkdaemon.protocol.errorcodes import ErrorCode, describe_error, error_since
from mkdaemon.protocol.generations import FC_GENERATIONS, NC_GENERATIONS
from mkdaemon.protocol.settings import known_revisions, layout_of
from mkdaemon.protocol.settings_fields import ParameterKind
from mkdaemon.protocol.settings_table import PARAMETERS, REVISIONS
from mkdaemon.protocol.wire import MESSAGES
from mkdaemon.telemetry.danger import Confirm, Danger
from tools.markdown import table


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
