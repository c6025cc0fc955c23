"""Runs procedures of the protocol over a link: directly, or through a NaviCtrl that passes the line through.

A procedure is a pure generator (`mkdaemon.protocol.procedures`); here its requests become frames, its pauses time. Each
request behind a NaviCtrl is a separate passage, so that telemetry, which stops meanwhile, tells about the motors
before the next one.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar

from mkdaemon.errors import CommandRejectedError, MkError, ProtocolError, RequestTimeoutError
from mkdaemon.link.discovery import redirection
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.procedures.steps import (
    Ask,
    LiveSet,
    LiveSetAtRisk,
    Pause,
    Procedure,
    Progress,
    Step,
)
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.refusals import Token

if TYPE_CHECKING:
    from mkdaemon.link.link import Link

BUSY_WAIT: Final = 0.2
"""Before asking again what could not be asked [s]."""
_PASSING: Final = (Token.BUSY, Token.BOARD_UNPROVEN)
"""Refusals after which a procedure asks again: the line had no room, or a frame that passes it through was lost."""
_BEHIND: Final = (Board.FC, Board.MAG)
"""Boards a NaviCtrl can pass the line through to."""

_Result = TypeVar("_Result")


class InterruptedProcedureError(MkError):
    """A procedure was stopped from outside; it has left the board as it promises to."""


class Observer(Protocol):
    """Receives the progress of a procedure, and may forbid its requests."""

    def progress(self, progress: Progress) -> None:
        """Progress of the procedure."""

    async def live_set_at_risk(self, wanted: LiveSet) -> None:
        """From the next request on another set may be live; an `MkError` ends the procedure before that."""

    async def live_set_proven(self) -> None:
        """The live set is the right one."""

    async def check(self, board: Board, message: WireMessage) -> None:
        """Let a request pass, or raise `CommandRejectedError`; asked before the line is passed through."""

    async def prove(self, board: Board, message: WireMessage) -> None:
        """Make sure that the board hears us, or raise `CommandRejectedError`; asked right before the request."""


class SilentObserver:
    """Lets everything pass and keeps nothing: for procedures that only read what is harmless to read."""

    def progress(self, progress: Progress) -> None:
        """Ignore it."""

    async def live_set_at_risk(self, wanted: LiveSet) -> None:
        """Refuse: a note of the live set is needed.

        Raises:
            ProtocolError: always.
        """
        msg = f"no note exists of the live set {wanted.active}"
        raise ProtocolError(msg)

    async def live_set_proven(self) -> None:
        """Ignore it."""

    async def check(self, board: Board, message: WireMessage) -> None:
        """Let it pass."""

    async def prove(self, board: Board, message: WireMessage) -> None:
        """Let it pass."""


async def run_procedure(
    link: Link, procedure: Procedure[_Result], observer: Observer, *, purpose: Purpose = Purpose.REQUEST
) -> _Result:
    """Run a procedure to its end.

    A cancellation is handed to the procedure once, so that it can leave the board as it found it; then this raises
    `InterruptedProcedureError`. A second one ends it where it stands.

    Args:
        link: the line.
        procedure: what to do.
        observer: hears of it.
        purpose: of every request; BACKGROUND if no caller waits.

    Raises:
        MkError: whatever the procedure, the observer or the link raised.
        ProtocolError: the procedure took no step.
    """
    step = next(procedure, None)
    is_interrupted = False
    while step is not None:
        try:
            answer = await _take(link, step, observer, purpose)
        except MkError as error:
            move = _thrower(procedure, error)
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if is_interrupted or task is None:
                procedure.close()
                raise
            task.uncancel()
            is_interrupted = True
            move = _thrower(procedure, InterruptedProcedureError("interrupted"))
        else:
            move = _sender(procedure, answer)
        try:
            step = move()
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]  # a generator's value is untyped at run time
    msg = "the procedure was cancelled before it started"
    raise ProtocolError(msg)


async def ask_once(link: Link, step: Ask, observer: Observer, purpose: Purpose) -> WireMessage | None:
    """Send one request once; the answer where one came in time that fits.

    None, too, where nothing was sent because the line is full, or the board did not prove that it hears us: a
    NaviCtrl confirms no redirection, so one that the line lost is seen only by that.

    Raises:
        CommandRejectedError: the observer or the link refused it for another reason.
        LinkLostError: the port is not open, or was lost meanwhile.
    """
    await observer.check(step.board, step.message)
    try:
        async with way_to(link, step.board, step.message):
            await observer.prove(step.board, step.message)
            answer = await link.request(
                step.message, board=step.board, timeout=step.timeout, retries=0, purpose=purpose
            )
    except RequestTimeoutError:
        return None
    except CommandRejectedError as error:
        if error.token not in _PASSING:
            raise
        await asyncio.sleep(BUSY_WAIT)
        return None
    return answer if step.accepts(answer) else None


def is_behind(link: Link, board: Board, message: WireMessage) -> bool:
    """Whether a board hears a message only while the NaviCtrl in front of it passes the line through."""
    return link.direct_board is Board.NC and board in _BEHIND and not message.spec.is_forwarded


@asynccontextmanager
async def way_to(
    link: Link, board: Board, message: WireMessage, admit: Callable[[], None] = lambda: None
) -> AsyncIterator[None]:
    """Let a board hear a message: a NaviCtrl in front of it passes the line through while the context lives.

    Args:
        link: the line.
        board: the addressee.
        message: the message.
        admit: see `redirection`.

    Raises:
        CommandRejectedError: `not_redirectable`, `link_down`, `motors_not_known_off`.
    """
    if not is_behind(link, board, message):
        yield
        return
    async with redirection(link, board, admit):
        yield


async def _take(link: Link, step: Step, observer: Observer, purpose: Purpose) -> WireMessage | None:
    """Do one step; the answer to a request, if it has one."""
    match step:
        case Ask():
            return await ask_once(link, step, observer, purpose)
        case Pause():
            await asyncio.sleep(step.seconds)
        case Progress():
            observer.progress(step)
        case LiveSetAtRisk():
            await observer.live_set_at_risk(step.wanted)
        case _:
            await observer.live_set_proven()
    return None


def _sender(procedure: Procedure[Any], answer: WireMessage | None) -> Callable[[], Step]:
    return lambda: procedure.send(answer)


def _thrower(procedure: Procedure[Any], error: MkError) -> Callable[[], Step]:
    return lambda: procedure.throw(error)
