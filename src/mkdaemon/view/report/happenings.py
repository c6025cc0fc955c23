"""What happened in a flight: its events as lines of a log, and its refusals by their token."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from pydantic import ValidationError

from mkdaemon.reading import EventLine, Sort, key_spec, line_of
from mkdaemon.telemetry.tone import Tone
from mkdaemon.view.report.said import short, text_of

MOST: Final = 20_000
"""Happenings that are kept of a recording; what comes later is counted."""


def happening_of(at: float, suffix: str, fields: Mapping[str, Any]) -> EventLine | None:
    """An event of a recording at a time [s]; None for what is none, as of another version or a damaged file."""
    spec = key_spec(suffix)
    if spec is None or spec.carries is None:
        return None
    try:
        line = line_of(spec.carries.model_validate(fields))
    except ValidationError:
        return None
    return None if line is None else replace(line, at=at, text=short(line.text), fix=short(line.fix))


def lost_line(at: float, fields: Mapping[str, Any]) -> EventLine:
    """The line was lost or closed, at a time [s]."""
    return EventLine(at, 0.0, Sort.LINE, Tone.WARN, f"the line was lost or closed: {text_of(fields, 'reason')}")


@dataclass(frozen=True, slots=True)
class RefusalCount:
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


def refusals(happenings: Sequence[EventLine]) -> list[RefusalCount]:
    """Refusals by token, the most frequent first."""
    refused = [one for one in happenings if one.sort is Sort.REFUSAL]
    counts = Counter(one.token for one in refused)
    firsts: dict[str, EventLine] = {}
    for one in refused:
        firsts.setdefault(one.token, one)
    found = [RefusalCount(token, counts[token], one.text, one.fix, one.at) for token, one in firsts.items()]
    return sorted(found, key=lambda one: -one.count)
