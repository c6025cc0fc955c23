"""The tables of messages in docs/troubles.md: every refusal, camera alarm, link state, cause and check, as printed.

The prose of the page is written by hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from enum import StrEnum
from itertools import groupby
from typing import Final, NamedTuple

from mkdaemon.cli.mkdaemon.doctor.check import Check, Needs
from mkdaemon.cli.mkdaemon.doctor.table import CHECKS
from mkdaemon.link.session import verdict
from mkdaemon.telemetry.control import CauseKind
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import Token
from mkdaemon.telemetry.vision import Alarm
from mkdaemon.vision.pipeline import ALARM_ADVICE
from tools.markdown import table

_NEEDS: Final = {Needs.MACHINE: "", Needs.CONFIG: ", with a file", Needs.DAEMON: ", with a daemon"}


def doctor_rows() -> Iterator[tuple[str, str]]:
    """Return for each check, in the order of the table, what is printed, and why it matters and what to do."""
    for check in CHECKS:
        shown = check.described()
        command = f"`{shown.command}`{' (safe)' if check.is_safe else ''}" if shown.command else ""
        remedy = " ".join(part for part in (shown.why, shown.fix, command) if part)
        yield f"**{shown.name}** ({_grade(check)}): {shown.what}", remedy


def _grade(check: Check) -> str:
    return f"{check.severity}{_NEEDS[check.needs]}"


_HEAD: Final = ("printed", "what to do")
_LINE: Final = "`mkctl health`; [link](link.md#states)"
_CAMERA: Final = "[vision](vision.md#states-and-alarms)"


class Message(NamedTuple):
    """One row.

    Attributes:
        printed: what a program prints; words in braces are filled in.
        remedy: what to do about it, or the page that explains it.
    """

    printed: str
    remedy: str


def messages() -> list[Message]:
    """Every message of the tables, in the order of its letters."""
    found = [Message(f"{token.value}: {token.reason}", token.fix) for token in Token]
    found += [Message(f"link {condition.value}", _LINE) for condition in LinkCondition]
    found += [_cut(reason, _LINE) for reason in verdict_reasons()]
    found += [_alarm(alarm) for alarm in Alarm]
    found += [Message(kind.words, "[safety](safety.md#what-ends-a-flight)") for kind in CauseKind]
    return sorted(found, key=lambda message: re.sub(r"\W+", " ", message.printed).casefold())


def verdict_reasons() -> Iterator[str]:
    """Every fixed reason of a verdict on the line."""
    for name, value in vars(verdict).items():
        if name.isupper() and isinstance(value, str):
            yield value


def _messages(_: None) -> Iterator[str]:
    """A table for each first letter."""
    letters = groupby(messages(), key=lambda message: _first_letter(message.printed))
    for letter, found in letters:
        yield from (f"\n### {letter}\n", *table(_HEAD, found))


def _checks(_: None) -> Iterator[str]:
    """What the doctor looks at."""
    yield from table(_HEAD, doctor_rows())


def _first_letter(printed: str) -> str:
    return "Begins with a number" if printed.startswith("{") else re.sub(r"\W+", "", printed)[:1].upper()


def _alarm(alarm: StrEnum) -> Message:
    """An alarm by its fixed text, or by its name where the text is composed of measured numbers."""
    advice = next((text for kind, text in ALARM_ADVICE.items() if kind is alarm), None)
    return Message(f"camera alarm {alarm.value}", _CAMERA) if advice is None else _cut(advice, _CAMERA)


def _cut(text: str, page: str) -> Message:
    """A message whose advice stands behind its colon."""
    printed, colon, remedy = text.partition(": ")
    return Message(printed, f"{remedy}; {page}" if colon else page)


TABLES: Final = {"messages": _messages, "checks": _checks}
"""By the names that the page gives them."""
