"""Requests: how long boards take, which answer belongs to which question, what to try again. Pure; driven with `now`.

There is no negative acknowledgement anywhere in the protocol: everything refused, damaged or misunderstood is silence.
So each command has a time-out from measured reply times, and retries where repeating cannot harm.
Source: docs/firmware-notes, "Timing"; docs/protocol.md, "Limits".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from mkdaemon.protocol.wire import Board, WireMessage

LATE_WINDOW: Final = 5.0
"""How long after its end a request's answer is still recognised as late or double [s]; deaf FlightCtrls keep one."""


@dataclass(frozen=True, slots=True)
class Policy:
    """How one command is asked.

    Attributes:
        timeout: wait for the first answer [s]; every retry waits 1.5 times longer than the one before.
        retries: further attempts.
        deaf: how long the board does not listen after the command [s].
    """

    timeout: float = 0.3
    retries: int = 3
    deaf: float = 0.0


_DEFAULT: Final = Policy()
_POLICIES: Final[dict[tuple[Board, str], Policy]] = {
    # FlightCtrl: replies take 5 to 40 ms alone and 25 ms more beside a debug stream.
    (Board.FC, "v"): Policy(0.15, 4),
    (Board.FC, "g"): Policy(0.15, 4),
    (Board.FC, "a"): Policy(0.15, 4),
    (Board.FC, "p"): Policy(0.2, 3),
    (Board.FC, "n"): Policy(0.2, 3),
    (Board.FC, "q"): Policy(0.4, 4),
    (Board.FC, "t"): Policy(0.2, 0),
    (Board.FC, "s"): Policy(2.5, 1, deaf=1.33),
    (Board.FC, "f"): Policy(1.5, 1, deaf=0.73),
    (Board.FC, "m"): Policy(1.0, 1, deaf=0.3),
    (Board.FC, "u"): Policy(1.3, 2, deaf=0.0),
    (Board.FC, "w"): Policy(1.3, 0, deaf=1.0),
    (Board.FC, "x"): Policy(0.3, 0),
    (Board.FC, "e"): Policy(0.3, 0, deaf=0.85),
    (Board.FC, "r"): Policy(0.3, 0, deaf=1.5),
    (Board.FC, "o"): Policy(0.3, 0, deaf=2.5),
    (Board.FC, "R"): Policy(0.3, 0, deaf=5.25),
    # NaviCtrl: 4 ms when idle; V, E and L starve for seconds under a saturating stream, an SD card write stalls 2 s.
    (Board.NC, "v"): Policy(0.3, 5),
    (Board.NC, "e"): Policy(0.4, 4),
    (Board.NC, "l"): Policy(0.4, 4),
    (Board.NC, "a"): Policy(0.3, 5),
    (Board.NC, "z"): Policy(0.15, 0),
    (Board.NC, "w"): Policy(0.5, 3),
    (Board.NC, "x"): Policy(0.4, 4),
    (Board.NC, "j"): Policy(0.4, 4),
    (Board.NC, "t"): Policy(0.4, 0),
    (Board.NC, "R"): Policy(0.3, 0, deaf=5.25),
}
_SLOT_RESET: Final = Policy(1.5, 0, deaf=0.5)
"""`q` 10..29 rewrites the EEPROM: never repeated."""


def policy_for(board: Board, message: WireMessage) -> Policy:
    """How a command is asked."""
    if board is Board.FC and message.spec.id == "q" and 10 <= getattr(message, "index", 0) <= 29:
        return _SLOT_RESET
    return _POLICIES.get((board, message.spec.id), _DEFAULT)


def _same(*names: str) -> Callable[[Any, Any], bool]:
    return lambda asked, came: all(getattr(asked, name) == getattr(came, name) for name in names)


def _same_index_or(*special: int) -> Callable[[Any, Any], bool]:
    return lambda asked, came: came.index == asked.index or came.index in special or asked.index in special


def _settings_match(asked: Any, came: Any) -> bool:
    """255 asks for the active set, whichever it is; 10..29 answer with the slot that was reset."""
    wanted = asked.index
    if wanted == 255:
        return True
    if 10 <= wanted <= 29:
        return bool(came.index == min(max(wanted % 10, 1), 5))
    return bool(came.index == wanted)


_MATCHES: Final[dict[tuple[Board, str], Callable[[Any, Any], bool]]] = {
    (Board.NC, "z"): _same("pattern"),
    (Board.NC, "j"): _same("id"),
    (Board.NC, "x"): lambda asked, came: came.number == asked.index,
    (Board.NC, "w"): _same_index_or(0),
    (Board.FC, "q"): _settings_match,
    (Board.FC, "u"): _same("motor"),
}
"""Which answer fits which question, where board and letter do not tell enough."""


def _label_matches(asked: Any, came: Any) -> bool:
    return bool(came.index == min(asked.index, 31))


def _page_matches(asked: Any, came: Any) -> bool:
    return bool(came.page in (asked.page, came.last_page))


_COMMON_MATCHES: Final[dict[str, Callable[[Any, Any], bool]]] = {"a": _label_matches, "l": _page_matches}


def answers(asked: WireMessage, board: Board, came: WireMessage, sender: Board) -> bool:
    """Whether a message answers a question, by sender, letter and content."""
    if came.spec.id != asked.spec.reply or (board is not Board.ANY and sender is not board):
        return False
    match = _MATCHES.get((sender, asked.spec.id)) or _COMMON_MATCHES.get(asked.spec.id)
    if match is None:
        return True
    try:
        return match(asked, came)
    except AttributeError:  # a layout without the field: the letter must do
        return True


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
