"""The tables of docs/modes.md: phases, events, transitions, the pilot's hands, and admission."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum
from functools import partial
from typing import Final

from mkdaemon.control.admission.beginnings import BY_TARGET, MANOEUVRES, Concern
from mkdaemon.control.admission.row import AdmissionRow, Rule
from mkdaemon.control.admission.rows import ROWS as ADMISSION
from mkdaemon.control.modes import ROWS, Reaction, Row, Trigger
from mkdaemon.control.pilots_hands import HANDS
from mkdaemon.telemetry.control import Phase
from tools.markdown import table

_TOGETHER: Final[Mapping[tuple[Concern, ...], str]] = {
    MANOEUVRES: "every manoeuvre",
    BY_TARGET: "every manoeuvre by the target",
    tuple(kind for kind in BY_TARGET if kind is not Concern.LAND): "every manoeuvre by the target but landing",
    tuple(kind for kind in BY_TARGET if kind is not Concern.TAKE_OFF): "every manoeuvre by the target but take-off",
}
"""Concerns that have a name together."""


def _meanings(words: type[StrEnum], _: None) -> Iterator[str]:
    """Members of an enumeration with the string below each."""
    tree = ast.parse(inspect.getsource(words)).body[0]
    assert isinstance(tree, ast.ClassDef)
    rows = [
        (f"`{words[ast.unparse(member.targets[0])].value}`", " ".join(str(text.value.value).split()))
        for member, text in zip(tree.body, tree.body[1:], strict=False)
        if isinstance(member, ast.Assign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    ]
    return table(("name", "meaning"), rows)


def _transitions(_: None) -> Iterator[str]:
    head = ("from", "event", "guard", "to", "sends", "failsafe", "reason")
    return table(head, map(_transition, ROWS))


def _transition(row: Row) -> tuple[str, ...]:
    sources = " ".join(f"`{source.value}`" for source in row.sources)
    failsafe = "yes" if row.reaction in {Reaction.RELEASE, Reaction.NEUTRAL} and not row.is_asked else ""
    event, target = f"`{row.event.value}`", f"`{row.target.value}`"
    return sources, event, row.guard.meaning, target, row.reaction.value, failsafe, row.reason


def _hands(_: None) -> Iterator[str]:
    rows = ((f"`{row.phase.value}`", row.manoeuvre or "any", row.stage or "any", row.words) for row in HANDS)
    return table(("phase", "manoeuvre", "stage", "the pilot"), rows)


def _admission(is_wanted: Callable[[AdmissionRow], bool], _: None) -> Iterator[str]:
    rows = (row for row in ADMISSION if is_wanted(row))
    head = ("check", "applies to", "fails if", "action", "refusal")
    return table(head, ((row.name, _concerns(row), row.stands, row.rule.value, _refusals(row)) for row in rows))


def _is_of_flight(row: AdmissionRow) -> bool:
    return any(concern in MANOEUVRES for concern in row.concerns)


def _concerns(row: AdmissionRow) -> str:
    return _TOGETHER.get(row.concerns) or ", ".join(concern.value for concern in row.concerns)


def _refusals(row: AdmissionRow) -> str:
    return "" if row.rule is Rule.WAITS else ", ".join(f"`{token.value}`" for token in row.tokens)


TABLES: Final[Mapping[str, Callable[[None], Iterator[str]]]] = {
    "phases": partial(_meanings, Phase),
    "events": partial(_meanings, Trigger),
    "sent": partial(_meanings, Reaction),
    "transitions": _transitions,
    "hands": _hands,
    "checks": partial(_admission, lambda row: row.is_shown),
    "manoeuvres": partial(_admission, lambda row: _is_of_flight(row) and not row.is_shown),
    "others": partial(_admission, lambda row: not _is_of_flight(row) and not row.is_shown),
    "rules": lambda _: table(("rule", "meaning"), ((rule.value, rule.meaning) for rule in Rule)),
}
"""By the names that the page gives them."""
