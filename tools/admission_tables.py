"""The tables of admission in docs/modes.md, made from the rows of control/admission."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final

from mkdaemon.control.admission.beginnings import BY_TARGET, MANOEUVRES, Concern
from mkdaemon.control.admission.row import AdmissionRow, Rule
from mkdaemon.control.admission.rows import ROWS
from tools.markdown import table

_LANDING: Final = tuple(kind for kind in BY_TARGET if kind is not Concern.LAND)
_IN_SIGHT: Final = tuple(kind for kind in BY_TARGET if kind is not Concern.TAKE_OFF)
_TOGETHER: Final[Mapping[tuple[Concern, ...], str]] = {
    MANOEUVRES: "every manoeuvre",
    BY_TARGET: "every manoeuvre by the target",
    _LANDING: "every manoeuvre by the target but landing",
    _IN_SIGHT: "every manoeuvre by the target but take-off",
}
"""Concerns that have a name together."""


def _is_of_flight(row: AdmissionRow) -> bool:
    return any(concern in MANOEUVRES for concern in row.concerns)


def _checks() -> Iterator[str]:
    return _lines(row for row in ROWS if row.is_shown)


def _manoeuvres() -> Iterator[str]:
    return _lines(row for row in ROWS if _is_of_flight(row) and not row.is_shown)


def _others() -> Iterator[str]:
    return _lines(row for row in ROWS if not _is_of_flight(row) and not row.is_shown)


def _rules() -> Iterator[str]:
    return table(("rule", "meaning"), ((rule.value, rule.meaning) for rule in Rule))


def _lines(rows: Iterable[AdmissionRow]) -> Iterator[str]:
    """A table of rows, and below it what to do about each refusal; in one table the lines were 400 characters long."""
    rows = tuple(rows)
    head = ("check", "applies to", "fails if", "action", "refusal")
    yield from table(head, ((row.name, _concerns(row), row.stands, row.rule.value, _refusals(row)) for row in rows))
    tokens = dict.fromkeys(token for row in rows for token in row.tokens if row.rule is not Rule.WAITS)
    if tokens:
        yield ""
        yield from table(("refusal", "what to do"), ((f"`{token.value}`", token.fix) for token in tokens))


def _concerns(row: AdmissionRow) -> str:
    return _TOGETHER.get(row.concerns) or ", ".join(concern.value for concern in row.concerns)


def _refusals(row: AdmissionRow) -> str:
    return "" if row.rule is Rule.WAITS else ", ".join(f"`{token.value}`" for token in row.tokens)


TABLES: Final[Mapping[str, Callable[[], Iterator[str]]]] = {
    "rules": _rules,
    "checks": _checks,
    "manoeuvres": _manoeuvres,
    "others": _others,
}
"""Every table by its name."""
