"""The verdict on a line: its condition, the reason in words, and since when."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, NamedTuple

from mkdaemon.telemetry.link import LinkCondition

STUCK: Final = "the port takes no bytes: flow control stops it, or its reader hangs"
"""Reason of a stuck port."""
NOTHING: Final = "nothing arrives: check power, wiring and that this is the right port"
"""Reason of a line that was always silent."""
STOPPED: Final = "nothing arrives any more: the board was switched off or has stopped, or a cable came off"
"""Reason of a line that was heard before."""
RAN_OUT: Final = (
    "nothing arrives any more; before, the board sent but did not answer, until its streams ran out: check the "
    "board's RX wire"
)
"""Reason of a line that was one-way before."""
UNANSWERED: Final = "frames arrive, but nothing we send is answered: check the board's RX wire"
"""Reason of a one-way line."""
QUIET: Final = "nothing arrives, and requests pause for 6 s: the last release was not confirmed"
"""Reason of a mute line while requests would keep an old stick command alive."""
DAMAGED: Final = "frames arrive damaged, and nothing we send is answered"
"""Reason of a line on which only damage arrives beside a few frames."""
NO_FRAME: Final = "bytes arrive, but no frame: wrong baud, or a damaged line"
"""Reason of garbage."""
RESTARTING: Final = "a board has booted: its streams begin again"
"""Reason of streams that a boot has ended."""


BOOTS: Final = 'a board boots ("{text}"): it listens again in a few seconds'
"""Reason of a silence after boot text."""
PLAIN_TEXT: Final = 'only plain text arrives ("{text}"): the board boots, or prints something'
"""Reason of a line on which only text arrives."""
STOOD_STILL: Final = "this program did not run for {seconds:.1f} s: the machine is busy, or the program was stopped"
"""Reason of what was missed while this program did not run."""
BUSY: Final = "but this program did not run for {percent:.0f} % of the time: look at the load of this machine first"
"""Added to a verdict that was found on a machine without time for us."""
INTERMITTENT: Final = "it was lost {times} times in {seconds:g} s: the link is intermittent"
"""Reason of a line that works now and was lost a moment ago, more than once."""


def shorten(text: str) -> str:
    """One short line of a text that a board printed."""
    return " ".join(text.split())[:40]


def boots(text: bytes) -> str:
    """`BOOTS`, filled in."""
    return BOOTS.format(text=shorten(text.decode("latin-1")))


def plain_text(text: str) -> str:
    """`PLAIN_TEXT`, filled in."""
    return PLAIN_TEXT.format(text=shorten(text))


def stood_still(seconds: float) -> str:
    """`STOOD_STILL`, filled in."""
    return STOOD_STILL.format(seconds=seconds)


def busy(share: float) -> str:
    """`BUSY`, filled in."""
    return BUSY.format(percent=100 * share)


def comes_and_goes(times: int, seconds: float) -> str:
    """`INTERMITTENT`, filled in."""
    return INTERMITTENT.format(times=times, seconds=seconds)


class VerdictCause(Enum):
    """The facts behind a verdict that others act on."""

    PORT_STUCK = auto()
    """The port takes no bytes."""
    PLAIN_TEXT = auto()
    """Text arrives and no frame: the line rate is right."""
    OTHER = auto()
    """No test is sent."""


class VerdictFinding(NamedTuple):
    """One look at the evidence.

    Attributes:
        condition: the one word.
        reason: one sentence: what was seen, and what to do where something can be done.
        cause: what it stands on.
    """

    condition: LinkCondition
    reason: str
    cause: VerdictCause = VerdictCause.OTHER


@dataclass(frozen=True, slots=True)
class HeldFinding:
    """A finding that holds.

    Attributes:
        finding: what was found last.
        since: when its condition began [s; monotonic].
        silent_since: when the board was heard last before the silence that it is a part of, whatever that was called
            first [s]; infinite while the board is heard.
    """

    finding: VerdictFinding
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
        return self.condition.is_silent or self.cause is VerdictCause.PORT_STUCK

    @property
    def cause(self) -> VerdictCause:
        """What it stands on."""
        return self.finding.cause

    def followed_by(self, finding: VerdictFinding, now: float, last_arrival: float) -> HeldFinding:
        """The verdict after a new finding; another reason for the same condition does not restart it.

        Args:
            finding: the new one.
            now: [s].
            last_arrival: when the board was heard last, or silence was expected last [s].
        """
        since = self.since if finding.condition is self.condition else now
        silent_since = math.inf if finding.condition.hears_board else min(self.silent_since, last_arrival, now)
        return HeldFinding(finding, since, silent_since)
