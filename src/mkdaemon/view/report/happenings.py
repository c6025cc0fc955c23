"""What happened in a flight, in words: commands, refusals, modes, failsafes, marks, the log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from mkdaemon.view.report.said import number_of, part_of, short, text_of

_ACCEPTED: Final = "accepted"
MOST: Final = 20_000
"""Happenings that are kept of a recording; what comes later is counted."""


class Sort(StrEnum):
    """What a happening is; the value is what is shown."""

    COMMAND = "command"
    REFUSAL = "refusal"
    MODE = "mode"
    FAILSAFE = "failsafe"
    LOG = "log"
    WARNING = "warning"
    MARK = "mark"
    PROCEDURE = "procedure"
    MISSION = "mission"
    CLOCK = "clock"
    LINE = "line"


@dataclass(frozen=True, slots=True)
class Happening:
    """One line of the log of a flight.

    Attributes:
        at: when [s].
        sort: what it is.
        text: what happened.
        token: of a refusal; empty for none.
        fix: what to do about it; empty for none.
    """

    at: float
    sort: Sort
    text: str
    token: str = ""
    fix: str = ""


def _command(at: float, fields: Mapping[str, Any]) -> Happening:
    key, status, reason = text_of(fields, "key"), text_of(fields, "status"), text_of(fields, "reason")
    carried = part_of(fields, "fields")
    shown = carried if isinstance(carried, Mapping) else {}
    left_out = ("epoch", "sequence", "ttl", "secret", "echo")
    words = ", ".join(
        f"{name} {short(value)}" for name, value in shown.items() if value is not None and name not in left_out
    )
    what = short(f"{key} ({words})" if words else key)
    if status == _ACCEPTED:
        return Happening(at, Sort.COMMAND, what)
    text = f"{what}: {reason or status or 'refused'}"
    return Happening(at, Sort.REFUSAL, text, text_of(fields, "token"), text_of(fields, "fix"))


def _mode(at: float, fields: Mapping[str, Any]) -> Happening:
    words = f"{text_of(fields, 'before')} to {text_of(fields, 'after')}: {text_of(fields, 'reason')}"
    return Happening(at, Sort.MODE, words)


def _failsafe(at: float, fields: Mapping[str, Any]) -> Happening:
    released = {True: "; confirmed by the board", False: "; NOT confirmed by the board"}
    found = part_of(fields, "released")
    end = released.get(found, "") if isinstance(found, bool) else ""
    return Happening(at, Sort.FAILSAFE, f"{text_of(fields, 'action')}: {text_of(fields, 'reason')}{end}")


def _log(at: float, fields: Mapping[str, Any]) -> Happening:
    sort = Sort.LOG if text_of(fields, "level") == "info" else Sort.WARNING
    return Happening(at, sort, text_of(fields, "text"))


def _mark(at: float, fields: Mapping[str, Any]) -> Happening:
    holder = text_of(fields, "holder")
    return Happening(at, Sort.MARK, text_of(fields, "text") + (f" ({holder})" if holder else ""))


def _clock(at: float, fields: Mapping[str, Any]) -> Happening:
    step = number_of(fields, "step")
    return Happening(at, Sort.CLOCK, f"the system clock was set by {0.0 if step is None else step:+.3f} s")


def _mission(at: float, fields: Mapping[str, Any]) -> Happening:
    words = [short(value) for name, value in fields.items() if name != "stamp" and isinstance(value, str | int)]
    return Happening(at, Sort.MISSION, short(", ".join(words)))


MAKERS: Final[Mapping[str, Callable[[float, Mapping[str, Any]], Happening]]] = {
    "event/command": _command,
    "event/mode": _mode,
    "event/failsafe": _failsafe,
    "event/log": _log,
    "event/mark": _mark,
    "event/clock": _clock,
    "event/mission": _mission,
}
"""How each key becomes a happening."""


@dataclass(frozen=True, slots=True)
class Refused:
    """Everything that was refused for one reason.

    Attributes:
        token: of the refusal.
        count: how often.
        text: what was refused first, and why.
        fix: what to do about it.
        first: when the first of them was [s].
    """

    token: str
    count: int
    text: str
    fix: str
    first: float


def refusals(happenings: list[Happening]) -> list[Refused]:
    """Refusals by token, the most frequent first."""
    refused = [one for one in happenings if one.sort is Sort.REFUSAL]
    counts = Counter(one.token for one in refused)
    firsts: dict[str, Happening] = {}
    for one in refused:
        firsts.setdefault(one.token, one)
    found = [Refused(token, counts[token], one.text, one.fix, one.at) for token, one in firsts.items()]
    return sorted(found, key=lambda one: -one.count)
