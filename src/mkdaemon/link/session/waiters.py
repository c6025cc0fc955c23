"""Who waits for what: futures of callers, settled with what the dialogue says became of their questions."""

from __future__ import annotations

import asyncio

from mkdaemon.errors import LinkLostError, RequestTimeoutError
from mkdaemon.link.session.dialogue import Dialogue
from mkdaemon.link.session.questions import Answered, Outcome, Unanswered
from mkdaemon.link.session.traffic import ReleaseResult
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.control import ReleaseOutcome

Answer = asyncio.Future[WireMessage | None]
"""Of a question: its answer; None where it was sent and none ever comes."""


class Waiters:
    """Everybody who waits."""

    def __init__(self) -> None:
        self._releases: list[asyncio.Future[ReleaseResult]] = []

    def for_answer(self) -> Answer:
        """Return what a caller waits on for an answer; hand it to the dialogue as token."""
        return asyncio.get_running_loop().create_future()

    def for_release(self) -> asyncio.Future[ReleaseResult]:
        """Return what a caller waits on for the end of the release under way."""
        waiter: asyncio.Future[ReleaseResult] = asyncio.get_running_loop().create_future()
        self._releases.append(waiter)
        return waiter

    def settle(self, dialogue: Dialogue) -> None:
        """Hand out what is known by now."""
        for outcome in dialogue.questions.take_finished():
            waiter = outcome.pending.token
            if isinstance(waiter, asyncio.Future) and not waiter.done():
                _resolve(waiter, outcome, is_open=dialogue.is_open)
        if self._releases and not dialogue.steering.is_releasing and dialogue.steering.plan is not None:
            self.end_releases(dialogue.steering.plan.result())

    def port_lost(self, reason: str) -> None:
        """A release that waits cannot be sent now; it is the first thing sent after opening."""
        self.end_releases(ReleaseResult(ReleaseOutcome.NOT_SENT, 0, 0, reason))

    def end_releases(self, result: ReleaseResult) -> None:
        """Hand everybody who waits for a release its result."""
        waiters, self._releases = self._releases, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(result)


def _resolve(waiter: Answer, outcome: Outcome, *, is_open: bool) -> None:
    match outcome:
        case Answered():
            waiter.set_result(outcome.answer)
        case Unanswered():
            waiter.set_exception((RequestTimeoutError if is_open else LinkLostError)(outcome.reason))
