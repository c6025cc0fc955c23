"""Requests under way: which answer belongs to which question, what is late, what is double. Pure; driven with `now`.

There is no negative acknowledgement anywhere in the protocol: everything refused, damaged or misunderstood is silence.
So each message declares a time-out from measured reply times, and retries where repeating cannot harm (`Policy`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from mkdaemon.protocol.wire import Board, WireMessage

LATE_WINDOW: Final = 5.0
"""How long after its end a request's answer is still recognised as late or double [s]; deaf FlightCtrls keep one."""


def answers(asked: WireMessage, board: Board, came: WireMessage, sender: Board) -> bool:
    """Whether a message answers a question, by sender, letter and content."""
    if came.spec.id != asked.spec.reply or (board is not Board.ANY and sender is not board):
        return False
    return asked.spec.matches is None or asked.spec.matches(asked, came)


@dataclass(slots=True, eq=False)
class Pending:
    """One question under way.

    Attributes:
        message: the question.
        board: who is asked.
        attempts_left: sendings still allowed.
        timeout: for the attempt under way [s].
        expires: when this attempt is given up [s]; infinite while it waits for its turn.
        sent: attempts made.
        token: the caller's handle.
    """

    message: WireMessage
    board: Board
    attempts_left: int
    timeout: float
    token: object
    expires: float = float("inf")
    sent: int = 0
    last_sent: float = 0.0


@dataclass(slots=True)
class RequestBook:
    """All questions under way, and those ended lately.

    Attributes:
        answered: questions answered, since the start.
        unanswered: questions given up.
        late: answers to questions given up.
        duplicate: answers to questions already answered.
    """

    answered: int = 0
    unanswered: int = 0
    late: int = 0
    duplicate: int = 0
    _open: list[Pending] = field(default_factory=list)
    _ended: list[tuple[float, Pending, bool]] = field(default_factory=list)

    def open(self, pending: Pending) -> None:
        """Enter a question."""
        self._open.append(pending)

    def sent(self, pending: Pending, now: float) -> None:
        """One attempt went out."""
        pending.sent += 1
        pending.attempts_left -= 1
        pending.last_sent = now
        pending.expires = now + pending.timeout

    def received(self, message: WireMessage, sender: Board, now: float) -> Pending | None:
        """Return the question this message answers, and close it; counts late and double answers."""
        for pending in self._open:
            if pending.sent and answers(pending.message, pending.board, message, sender):
                self._close(pending, now, answered=True)
                return pending
        if self._ended:
            self._recognise(message, sender, now)
        return None

    def withdraw(self, pending: Pending, now: float) -> None:
        """The caller does not wait any more; its answer will be recognised and dropped."""
        if pending in self._open:
            self._close(pending, now, answered=None)

    def due(self, now: float) -> list[Pending]:
        """Return the questions whose attempt has timed out, without closing them."""
        return [pending for pending in self._open if pending.expires <= now]

    def give_up(self, pending: Pending, now: float) -> None:
        """No attempt is left."""
        self._close(pending, now, answered=False)

    def next_time(self) -> float:
        """When the next attempt times out [s]; infinite while none is under way."""
        return min((pending.expires for pending in self._open), default=float("inf"))

    def drain(self) -> list[Pending]:
        """Forget everything, because the port was lost; returns the questions under way."""
        left, self._open = self._open, []
        self._ended.clear()
        return left

    @property
    def pending(self) -> tuple[Pending, ...]:
        """Questions under way."""
        return tuple(self._open)

    def _close(self, pending: Pending, now: float, *, answered: bool | None) -> None:
        self._open.remove(pending)
        if answered:
            self.answered += 1
        elif answered is False:
            self.unanswered += 1
        if pending.sent:
            self._ended.append((now, pending, bool(answered)))

    def _recognise(self, message: WireMessage, sender: Board, now: float) -> None:
        self._ended = [entry for entry in self._ended if now - entry[0] <= LATE_WINDOW]
        for index, (_, pending, was_answered) in enumerate(self._ended):
            if answers(pending.message, pending.board, message, sender):
                if not was_answered:
                    self.late += 1
                    del self._ended[index]
                elif pending.sent > 1:
                    self.duplicate += 1
                    del self._ended[index]
                return
