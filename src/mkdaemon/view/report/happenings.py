"""What happened in a flight: events as lines of a log, refusals by their token, and what kept it from going on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

from mkdaemon.reading import EventLine, Sort, line_of
from mkdaemon.telemetry.tone import Tone
from mkdaemon.view.report.said import number_of, part_of, short, text_of, value_of

MOST: Final = 20_000
"""Happenings that are kept of a recording; what comes later is counted."""
MOST_TROUBLES: Final = 1000
"""Troubles that are kept of a recording; of the others nothing is reported here."""


def happening_of(at: float, suffix: str, fields: Mapping[str, Any]) -> EventLine | None:
    """An event of a recording at a time [s]; None for what is none, as of another version or a damaged file."""
    line = line_of(value_of(suffix, fields))
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


class Reason(NamedTuple):
    """One link of a chain of causes.

    Attributes:
        since: when it began [s].
        text: what it was, as reported last.
    """

    since: float
    text: str


@dataclass(slots=True)
class Trouble:
    """A time in which causes kept a flight from going on, as `control/status` reported them.

    Attributes:
        reported: when they were reported first [s].
        ended: when they were gone, or reported last [s].
        reasons: by kind, the effect first.
        is_over: a later status reported none.
    """

    reported: float
    ended: float
    reasons: dict[str, Reason] = field(default_factory=dict)
    is_over: bool = False


def take_causes(troubles: list[Trouble], at: float, fields: Mapping[str, object]) -> None:
    """Take the causes of a status into the troubles of its flight.

    Args:
        troubles: until now; the last one goes on or ends.
        at: time of the status [s].
        fields: of the status.
    """
    causes = part_of(fields, "causes")
    reported = [cause for cause in causes if text_of(cause, "text")] if isinstance(causes, list) else []
    trouble = troubles[-1] if troubles and not troubles[-1].is_over else None
    if trouble is not None:
        trouble.ended, trouble.is_over = at, not reported
    elif reported and len(troubles) < MOST_TROUBLES:
        trouble = Trouble(at, at)
        troubles.append(trouble)
    if trouble is None or not reported:
        return
    before, trouble.reasons = trouble.reasons, {}
    for cause in reported:
        kind, seconds = text_of(cause, "kind"), number_of(cause, "seconds")
        since = before[kind].since if kind in before else at - (seconds or 0.0)
        trouble.reasons[kind] = Reason(since, text_of(cause, "text"))
    for kind, reason in before.items():
        trouble.reasons.setdefault(kind, reason)
