"""What kept a flight from going on: the chains of causes that its statuses tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mkdaemon.view.report.said import number_of, part_of, text_of

MOST: Final = 1000
"""Troubles that are kept of a recording; of the others nothing is reported here."""


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
    elif reported and len(troubles) < MOST:
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
