"""Renewal interval of subscriptions, so that they do not expire: from the measured losses. Pure.

A board drops its streams when it has heard no stream request for `TIME_TO_LIVE`. Renewals are lost like every other
request, and not independently: interference lasts, so the request after a lost one is lost more often than others. Two
shares are followed for that, each with a cautious prior: requests lost after one that was answered, and requests lost
after one that was lost. The longest interval is taken with which the streams run out less than once in `ONCE_IN`.

A link test that is not answered counts as not heard. Its answer may have been lost as well: the estimate is cautious.
"""

from __future__ import annotations

from typing import Final

TIME_TO_LIVE: Final = 4.0
"""A NaviCtrl drops its streams this time after the last renewal, a FlightCtrl after 4.1 s [s]; docs/firmware-notes,
"Subscriptions"."""
ONCE_IN: Final = 360_000.0
"""Streams run out more rarely than once in this time: 100 hours [s]."""
SHORTEST: Final = 0.2
"""Renewals closer together fall into the same interference [s]."""
MEMORY: Final = 200.0
"""Link tests that count: 40 s at 5 Hz, so that an aircraft that flies away is noticed."""
PRIOR_FIRST: Final = (1.0, 19.0)
"""Before the first link test: as if 1 of 20 was lost after one that was answered: lost, answered."""
PRIOR_NEXT: Final = (1.0, 2.0)
"""As if 1 of 3 was lost after one that was lost."""


class HeardShare:
    """The shares of requests that the board does not hear, from the fates of link tests in the order of their end.

    Attributes:
        noted: number of link tests.
    """

    def __init__(self) -> None:
        """Begin with what the priors say."""
        self.noted = 0
        self._first = [0.0, 0.0]
        self._next = [0.0, 0.0]
        self._was_lost = False

    def note(self, *, is_answered: bool) -> None:
        """A link test was answered, or was not."""
        keep = 1.0 - 1.0 / MEMORY
        counts = self._next if self._was_lost else self._first
        counts[:] = [keep * count for count in counts]
        counts[is_answered] += 1.0
        self.noted += 1
        self._was_lost = not is_answered

    @property
    def first_lost(self) -> float:
        """Share of requests lost among those that follow one that was heard [0..1]."""
        return _mean(self._first, PRIOR_FIRST)

    @property
    def next_lost(self) -> float:
        """Share of requests lost among those that follow one that was lost [0..1]; never less than `first_lost`."""
        return max(_mean(self._next, PRIOR_NEXT), self.first_lost)

    @property
    def delivered(self) -> float:
        """Share of all requests that are heard [0..1]."""
        # The stationary share of losses of that chain, first / (1 + first - next).
        return 1.0 - self.first_lost / (1.0 + self.first_lost - self.next_lost)


def _mean(counts: list[float], prior: tuple[float, float]) -> float:
    lost, answered = counts[0] + prior[0], counts[1] + prior[1]
    return lost / (lost + answered)


def time_between_ends(interval: float, share: HeardShare, *, live: float = TIME_TO_LIVE) -> float:
    """Mean time after which streams run out [s].

    Args:
        interval: between two renewals [s].
        share: how many requests are heard.
        live: how long a board goes on without a renewal [s].

    Streams run out when enough renewals in a row are lost for none to fall into the time to live. Such a row begins
    with a renewal that follows a heard one.
    """
    # Losses as a chain of two states (E. Gilbert, Bell System Technical Journal 39 (1960), 1253): a row of n lost
    # renewals begins delivered / interval * first_lost times a second, and goes on with next_lost^(n - 1).
    in_a_row = max(int(live / interval + 1e-9), 1)
    begins = share.delivered / interval * share.first_lost
    return 1.0 / (begins * share.next_lost ** (in_a_row - 1))


def renewal_interval(share: HeardShare, longest: float) -> float:
    """Choose the time between two renewals [s].

    Args:
        share: how many requests are heard.
        longest: no more than this [s].

    Returns:
        The longest interval that keeps `ONCE_IN`, or `SHORTEST` where none does: then the requests for streams that
        are overdue are what keeps them.
    """
    most = int(TIME_TO_LIVE / SHORTEST + 1e-9)
    for in_a_row in range(max(int(TIME_TO_LIVE / longest), 1), most + 1):
        interval = min(TIME_TO_LIVE / in_a_row, longest)
        if time_between_ends(interval, share) >= ONCE_IN:
            return interval
    return SHORTEST
