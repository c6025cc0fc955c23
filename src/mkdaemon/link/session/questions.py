"""Questions on their way: queued, sent, answered, asked again, given up. Pure; driven with `now`.

Between the callers and the scheduler: the message's declaration (`MessageSpec.policy`) decides how often and how long
it is asked, and every question ends with exactly one outcome. There is no negative acknowledgement anywhere in the
protocol: everything refused, damaged or misunderstood is silence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from mkdaemon.link.session.fates import Tally
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.scheduler import QueuedTransmission, TransmitScheduler
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.messages import VersionRequest, VersionRequestWhich
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.link import Why
from mkdaemon.telemetry.refusals import Token, refuse

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
        board: the addressee.
        attempts_left: sendings still allowed.
        timeout: for the attempt under way [s].
        expires: when this attempt is given up [s]; infinite while it waits for its turn.
        sent: attempts made.
        is_out: an attempt waits for its answer.
        why: the last attempt stayed unanswered.
        token: the caller's handle.
    """

    message: WireMessage
    board: Board
    attempts_left: int
    timeout: float
    token: object
    expires: float = float("inf")
    sent: int = 0
    is_out: bool = False
    why: Why = Why.LOST


@dataclass(slots=True)
class RequestBook:
    """All questions under way, and those ended lately.

    Attributes:
        tally: what became of every attempt, since the start.
        duplicate: answers to questions already answered.
    """

    tally: Tally = field(default_factory=Tally)
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
        pending.expires = now + pending.timeout
        pending.is_out = True
        self.tally.sent += 1

    def received(self, message: WireMessage, sender: Board, now: float) -> Pending | None:
        """Return the question this message answers, and close it; counts late and double answers."""
        for pending in self._open:
            if pending.sent and answers(pending.message, pending.board, message, sender):
                if pending.is_out:
                    self.tally.answered += 1
                else:
                    self.tally.came_late(Why.LOST)
                self._close(pending, now, is_answered=True)
                return pending
        if self._ended:
            self._recognise(message, sender, now)
        return None

    def withdraw(self, pending: Pending, now: float) -> None:
        """The caller does not wait any more; its answer will be recognised and dropped."""
        if pending in self._open:
            self._end_attempt(pending, Why.WITHDRAWN)
            self._close(pending, now)

    def sent_for_good(self, pending: Pending, now: float) -> None:
        """It was sent, and no board ever answers it."""
        self.tally.silent += 1
        self._close(pending, now)

    def timed_out(self, pending: Pending) -> None:
        """The attempt under way has had its time."""
        self._end_attempt(pending, Why.LOST)

    def due(self, now: float) -> list[Pending]:
        """Return the questions whose attempt has timed out, without closing them."""
        return [pending for pending in self._open if pending.expires <= now]

    def give_up(self, pending: Pending, now: float) -> None:
        """No attempt is left."""
        self._close(pending, now)

    def next_time(self) -> float:
        """When the next attempt times out [s]; infinite while none is under way."""
        return min((pending.expires for pending in self._open), default=float("inf"))

    def drain(self) -> list[Pending]:
        """Forget everything, because the port was lost; returns the questions under way."""
        left, self._open = self._open, []
        for pending in left:
            self._end_attempt(pending, Why.OUTAGE)
        self._ended.clear()
        return left

    @property
    def pending(self) -> tuple[Pending, ...]:
        """Questions under way."""
        return tuple(self._open)

    def _end_attempt(self, pending: Pending, why: Why) -> None:
        if pending.is_out:
            pending.is_out, pending.why = False, why
            self.tally.gave_up(why)

    def _close(self, pending: Pending, now: float, *, is_answered: bool = False) -> None:
        self._open.remove(pending)
        if pending.sent and pending.message.spec.reply is not None:
            self._ended.append((now, pending, is_answered))

    def _recognise(self, message: WireMessage, sender: Board, now: float) -> None:
        self._ended = [entry for entry in self._ended if now - entry[0] <= LATE_WINDOW]
        for index, (_, pending, was_answered) in enumerate(self._ended):
            if answers(pending.message, pending.board, message, sender):
                if not was_answered:
                    self.tally.came_late(pending.why)
                    del self._ended[index]
                elif pending.sent > 1:
                    self.duplicate += 1
                    del self._ended[index]
                return


QUEUED: Final = 10.0
"""Longest time a question waits for the line [s]; longer than the 6 s it may be held back after a release."""


@dataclass(frozen=True, slots=True)
class QuestionAnswered:
    """A question that ended well.

    Attributes:
        pending: the question.
        answer: what the board said; None where it was sent and no answer ever comes.
    """

    pending: Pending
    answer: WireMessage | None


@dataclass(frozen=True, slots=True)
class Unanswered:
    """A question that was given up.

    Attributes:
        pending: the question.
        reason: why there is no answer.
    """

    pending: Pending
    reason: str


Outcome = QuestionAnswered | Unanswered
"""How a question ended."""


class Questions:
    """Everything asked and not answered yet.

    Attributes:
        book: the questions under way, and the counts of those that ended.
        deaf_until: a board does not listen until then, because of a request [s].
        deaf_because: what to wait for, in words.
    """

    def __init__(self, scheduler: TransmitScheduler, peers: Peers, health: HealthMonitor) -> None:
        self.book = RequestBook()
        self._scheduler = scheduler
        self._peers = peers
        self._health = health
        self._finished: list[Outcome] = []
        self.deaf_until = -math.inf
        self.deaf_because = ""

    def ask(
        self,
        message: WireMessage,
        board: Board,
        now: float,
        *,
        timeout: float | None = None,
        retries: int | None = None,
        purpose: Purpose = Purpose.REQUEST,
        token: object = None,
    ) -> Pending:
        """Ask a board; the answer comes back through `take_finished`.

        Raises:
            CommandRejectedError: the board cannot be reached, or too much waits already.
        """
        self._peers.check_reach(message, board)
        policy = message.spec.policy(board)
        pending = Pending(
            message,
            board,
            attempts_left=1 + (policy.retries if retries is None else retries),
            timeout=policy.timeout if timeout is None else timeout,
            token=token,
        )
        self.book.open(pending)
        if not self._queue(pending, purpose, now):
            self.book.withdraw(pending, now)
            raise refuse(Token.BUSY, detail=f"{self._scheduler.waiting} frames wait for the line already")
        return pending

    def withdraw(self, pending: Pending, now: float) -> None:
        """The caller does not wait any more."""
        self._scheduler.withdraw(pending)
        self.book.withdraw(pending, now)

    def sent(self, pending: Pending, now: float) -> None:
        """One attempt went out."""
        self.book.sent(pending, now)
        if isinstance(pending.message, VersionRequest | VersionRequestWhich):
            self._health.question_sent(now)
        deaf = pending.message.spec.policy(pending.board).deaf
        if deaf:
            self.deaf_until = max(self.deaf_until, now + deaf)
            self.deaf_because = f"{pending.board.word} to listen again after {pending.message.spec.key}"
            self._scheduler.deafen(pending.board, now + deaf)
            self._health.pause(now + deaf)
        if pending.message.spec.reply is None:
            self.book.sent_for_good(pending, now)
            self._finished.append(QuestionAnswered(pending, None))

    def received(self, message: WireMessage, board: Board, now: float) -> Pending | None:
        """A message arrived; returns the question it answers, if any."""
        pending = self.book.received(message, board, now)
        if pending is not None:
            self._health.board_answered(now)
            self._finished.append(QuestionAnswered(pending, message))
        return pending

    def step(self, now: float) -> None:
        """Ask again what was not answered in time, or give it up."""
        for pending in self.book.due(now):
            self._scheduler.resynchronise()
            self.book.timed_out(pending)
            if pending.attempts_left > 0:
                pending.expires = math.inf
                pending.timeout *= 1.5
                self._queue(pending, Purpose.RETRY, now)
            else:
                self.book.give_up(pending, now)
                reason = f"{pending.board.word} did not answer, asked {pending.sent} times"
                self._finished.append(Unanswered(pending, reason))

    def never_sent(self, pending: Pending, now: float) -> None:
        """It waited for its turn until it was too old."""
        self.book.give_up(pending, now)
        self._finished.append(Unanswered(pending, "the line was never free for the request"))

    def port_lost(self, reason: str) -> None:
        """Nothing under way will be answered any more."""
        self.deaf_until = -math.inf
        self._finished.extend(Unanswered(pending, reason) for pending in self.book.drain())

    @property
    def awaits_version(self) -> bool:
        """Whether a version request waits for its answer."""
        return any(
            pending.sent and isinstance(pending.message, VersionRequest | VersionRequestWhich)
            for pending in self.book.pending
        )

    def take_finished(self) -> list[Outcome]:
        """Return questions that ended since the last call, each with its outcome."""
        finished, self._finished = self._finished, []
        return finished

    @staticmethod
    def proves_sender(pending: Pending | None) -> bool:
        """Whether an answer tells about the board whose address it bears.

        A FlightCtrl asked for the NaviCtrl's release answers under its own address: proof of nothing.
        """
        return pending is None or not isinstance(pending.message, VersionRequestWhich)

    def _queue(self, pending: Pending, purpose: Purpose, now: float) -> bool:
        message = pending.message
        letter = message.spec.reply
        return self._scheduler.submit(
            QueuedTransmission(
                message.to_frame(pending.board),
                purpose,
                deadline=now + QUEUED,
                board=pending.board,
                message=message,
                reaches_fc=self._peers.reaches_fc(message, pending.board),
                slot=None if letter is None else (pending.board, letter),
                reply_within=pending.timeout,
                tag=pending,
            ),
            now,
        )
