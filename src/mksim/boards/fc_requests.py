"""What a FlightCtrl has been asked for: one slot a kind of reply, and its subscriptions.

Source: docs/firmware-notes, "Subscriptions".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from mksim.boards.generations import FC_MS, SHORT_PASS

SUBSCRIPTION_TIME: Final = 4000 * 1.025e-3
"""Streams stop so long after the last renewal: 4.1 s as measured."""


@dataclass(slots=True)
class Stream:
    """A subscription."""

    interval: int = 0
    due: float = 0.0

    def restart(self, now: float) -> None:
        """Begin a period at `now`."""
        self.due = now + (10 * self.interval + 1) * FC_MS + SHORT_PASS

    def is_due(self, now: float) -> bool:
        """Whether a frame must go out."""
        return self.interval > 0 and now >= self.due


@dataclass(slots=True)
class FcRequests:
    """Replies asked for and not yet sent, one slot each (None and False mean nothing is wanted), and the streams.

    Attributes:
        compass_at: when the next unasked compass feed is due [s].
        expire_at: when the streams end unless they are renewed [s].
    """

    compass_at: float
    version: int | None = None
    control: bool = False
    debug: bool = False
    label: int | None = None
    display: bool = False
    menu: int | None = None
    receiver: bool = False
    debug_stream: Stream = field(default_factory=Stream)
    attitude_stream: Stream = field(default_factory=Stream)
    display_stream: Stream = field(default_factory=Stream)
    expire_at: float = 0.0

    def renew(self, now: float) -> None:
        """Keep the streams alive."""
        self.expire_at = now + SUBSCRIPTION_TIME

    def end_expired(self, now: float, *, debug_is_endless: bool) -> None:
        """Stop the streams that nobody renewed."""
        if now < self.expire_at:
            return
        self.attitude_stream.interval = self.display_stream.interval = 0
        if not debug_is_endless:
            self.debug_stream.interval = 0
