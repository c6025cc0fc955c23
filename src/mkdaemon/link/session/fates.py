"""Outcomes of everything that needs an answer: link tests, requests, stick frames."""

from __future__ import annotations

from collections import Counter

from mkdaemon.telemetry.link import Fates, Why


class Tally:
    """Counts since the start.

    Attributes:
        sent: written to the port.
        answered: in time.
        late: answered after the time-out.
        silent: sent where no answer is due.
    """

    def __init__(self) -> None:
        """Start at zero."""
        self.sent = self.answered = self.late = self.silent = 0
        self._unanswered: Counter[Why] = Counter()

    def gave_up(self, why: Why) -> None:
        """Something stayed unanswered."""
        self._unanswered[why] += 1

    def came_late(self, why: Why) -> None:
        """An answer came to what was given up for this reason."""
        self._unanswered[why] -= 1
        self.late += 1

    @property
    def unanswered(self) -> int:
        """Given up, and no answer since."""
        return self._unanswered.total()

    def fates(self) -> Fates:
        """The counts; together they are `sent`."""
        decided = self.answered + self.late + self.unanswered + self.silent
        return Fates(
            sent=self.sent,
            answered=self.answered,
            late=self.late,
            unanswered=self.unanswered,
            waiting=self.sent - decided,
            silent=self.silent,
            **{why.value: self._unanswered[why] for why in Why},
        )
