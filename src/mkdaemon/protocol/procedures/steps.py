"""Procedures: conversations with a board that take several requests, written without I/O and without a clock.

A procedure is a generator. It yields what it wants done next and is sent what came back: the answer to a request, or
None when none came in time. The driver of a procedure owns the line: the daemon over its link
(`mkdaemon.link.procedures`), tests and campaigns over a simulated line in virtual time. A procedure ends with its
result or raises.

The line may lose, damage, delay and repeat frames, but keeps their order. Source: docs/firmware-notes, "Losses".
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from mkdaemon.errors import RequestTimeoutError
from mkdaemon.protocol.wire import Board, WireMessage


@dataclass(frozen=True, slots=True)
class Ask:
    """Send a request once and wait for its answer.

    Attributes:
        board: the addressee; only its frames can answer.
        message: the request.
        accepts: whether a message of that board answers this very request; late answers to others do not.
        timeout: how long to wait after the last byte was sent [s].
    """

    board: Board
    message: WireMessage
    accepts: Callable[[WireMessage], bool]
    timeout: float


@dataclass(frozen=True, slots=True)
class Pause:
    """Send nothing for a while, because the board is deaf.

    Attributes:
        seconds: how long [s].
    """

    seconds: float


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of the procedure for displays.

    Attributes:
        done: finished parts.
        total: all parts.
        what: the present part in words.
    """

    done: int
    total: int
    what: str


@dataclass(frozen=True, slots=True)
class LiveSet:
    """The parameter set a FlightCtrl flies with, as it must be again when a procedure has ended.

    Attributes:
        firmware: release of the FlightCtrl, for example `2.12a`.
        active: number of the active set.
        live: bytes of the live set, which is the active one.
        writing: bytes of the sets that are about to be written, by number; empty where sets are only read.
    """

    firmware: str
    active: int
    live: bytes
    writing: Mapping[int, bytes] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class LiveSetAtRisk:
    """From the next request on another set may be live: the driver notes which one must be restored.

    Attributes:
        wanted: what has to be live in the end.
    """

    wanted: LiveSet


@dataclass(frozen=True, slots=True)
class LiveSetProven:
    """The live set has been compared and is the right one: the note is not needed any more."""


Step = Ask | Pause | Progress | LiveSetAtRisk | LiveSetProven
"""What a procedure may want."""

_Result = TypeVar("_Result")
_Answer = TypeVar("_Answer", bound=WireMessage)
Procedure = Generator[Step, WireMessage | None, _Result]
"""A procedure that returns `_Result`."""


@dataclass(frozen=True, slots=True)
class Patience:
    """Time-outs and repeats for one answer.

    Attributes:
        attempts: how often a request is sent before giving up.
        timeout: wait for each answer [s]; four hundred milliseconds outlast every reply of an idle board.
    """

    attempts: int = 5
    timeout: float = 0.4


@dataclass(frozen=True, slots=True)
class Question(Generic[_Answer]):
    """A request, and which message answers it.

    Attributes:
        board: the addressee.
        message: the request.
        kinds: classes of the answer, one for each layout.
        fits: whether a message of these kinds answers this very request.
        what: the request in words, for messages.
    """

    board: Board
    message: WireMessage
    kinds: tuple[type[_Answer], ...]
    fits: Callable[[_Answer], bool]
    what: str

    def accepts(self, message: WireMessage) -> bool:
        """Whether a message is the answer."""
        return isinstance(message, self.kinds) and self.fits(message)


def ask(question: Question[_Answer], patience: Patience) -> Procedure[_Answer | None]:
    """Ask until there is an answer; None when patience ran out."""
    for _ in range(patience.attempts):
        answer = yield Ask(question.board, question.message, question.accepts, patience.timeout)
        if isinstance(answer, question.kinds) and question.fits(answer):
            return answer
    return None


def insist(question: Question[_Answer], patience: Patience) -> Procedure[_Answer]:
    """Ask until there is an answer.

    Raises:
        RequestTimeoutError: patience ran out.
    """
    answer = yield from ask(question, patience)
    if answer is None:
        board = question.board.word.upper()
        msg = f"{question.what}: no answer from the {board} in {patience.attempts} attempts; check the line"
        raise RequestTimeoutError(msg)
    return answer


def insist_twice(question: Question[_Answer], patience: Patience) -> Procedure[_Answer]:
    """Ask until two answers in a row say the same.

    The checksum has 12 bits: on a bad line about one damaged frame in four thousand passes it, but no two of them
    agree. A clean line costs one repetition.

    Raises:
        RequestTimeoutError: patience ran out, or no two answers agreed in five.
    """
    before = yield from insist(question, patience)
    for _ in range(4):
        again = yield from insist(question, patience)
        if again == before:
            return again
        before = again
    msg = f"{question.what}: two answers never agreed; the line is too bad, or the value is changing"
    raise RequestTimeoutError(msg)
