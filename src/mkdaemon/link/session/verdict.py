"""What is said about a line: the condition, why, and since when."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto
from typing import NamedTuple

from mkdaemon.telemetry.link import LinkCondition


class Cause(Enum):
    """What a verdict stands on, where somebody acts on it."""

    PORT_STUCK = auto()
    """The port takes no bytes."""
    PLAIN_TEXT = auto()
    """Text arrives and no frame: the line rate is right."""
    OTHER = auto()
    """Nobody asks."""


class Finding(NamedTuple):
    """One look at the evidence.

    Attributes:
        condition: the one word.
        reason: one sentence: what was seen, and what to do where something can be done.
        cause: what it stands on.
    """

    condition: LinkCondition
    reason: str
    cause: Cause = Cause.OTHER


@dataclass(frozen=True, slots=True)
class Verdict:
    """A finding that holds.

    Attributes:
        finding: what was found last.
        since: when its condition began [s; monotonic].
        silent_since: when the board was heard last before the silence that it is a part of, whatever that was called
            first [s]; infinite while the board is heard.
    """

    finding: Finding
    since: float
    silent_since: float = math.inf

    @property
    def condition(self) -> LinkCondition:
        """The one word."""
        return self.finding.condition

    @property
    def reason(self) -> str:
        """Why."""
        return self.finding.reason

    @property
    def is_outage(self) -> bool:
        """Whether the port is open and no right frame arrives, or it takes no bytes."""
        return self.condition.is_silent or self.cause is Cause.PORT_STUCK

    @property
    def cause(self) -> Cause:
        """What it stands on."""
        return self.finding.cause

    def followed_by(self, finding: Finding, now: float, last_arrival: float) -> Verdict:
        """The verdict after a new finding; another reason for the same condition does not begin it anew.

        Args:
            finding: the new one.
            now: [s].
            last_arrival: when the board was heard last, or silence was expected last [s].
        """
        since = self.since if finding.condition is self.condition else now
        silent_since = math.inf if finding.condition.hears_board else min(self.silent_since, last_arrival, now)
        return Verdict(finding, since, silent_since)
