"""One run of a procedure: its work, its client, and its reports."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import structlog

from mkdaemon.clock import Clock
from mkdaemon.daemon.audit import Outlet
from mkdaemon.daemon.procedures.journal import Journal, Note
from mkdaemon.errors import CommandRejectedError, LinkLostError, MkError
from mkdaemon.link.link import Link
from mkdaemon.link.procedures import InterruptedProcedureError, Observer
from mkdaemon.protocol.procedures.steps import LiveSet, Progress
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.procedure import ProcedureProgress, ProcedureState
from mkdaemon.telemetry.refusals import Token, refuse

_log = structlog.get_logger(__name__)

KEY = "event/progress"
"""Where progress is published."""


class RequestGuard(Protocol):
    """Checks single requests before they are sent: `mkdaemon.daemon.requests.BoardRequests` in earnest."""

    async def check_step(self, board: Board, message: WireMessage) -> None:
        """Let a step of a procedure pass or raise `CommandRejectedError`."""

    async def prove_board(self, board: Board, message: WireMessage) -> None:
        """Make sure that the board asked is the one that hears us."""


@dataclass(slots=True, eq=False)
class Job:
    """A procedure that was asked for.

    Attributes:
        verb: what it is.
        holder: the client that asked.
        work: does it; hears of itself through the observer.
        is_alone: it excludes flying, and motors must be known to stand still at each dangerous request.
        id: of this run.
        note_id: of the note in the journal that this run proves.
        done: its result, once it has one.
        task: runs it.
        is_cancelled: it has been asked to end early.
    """

    verb: str
    holder: str
    work: Callable[[Observer], Awaitable[Any]]
    is_alone: bool
    id: str = field(default_factory=lambda: secrets.token_hex(4))
    note_id: str = ""
    done: asyncio.Future[Any] = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    task: asyncio.Task[None] | None = None
    is_cancelled: bool = False

    def __post_init__(self) -> None:
        self.note_id = self.note_id or self.id
        # If the client is gone when it fails, no task takes the exception.
        self.done.add_done_callback(lambda done: done.cancelled() or done.exception())

    def cancel(self) -> None:
        """Let it end early and leave the board as it promises to; asked again, it goes on with that."""
        if self.task is not None and not self.is_cancelled:
            self.is_cancelled = True
            self.task.cancel()


class JobObserver:
    """Publishes a job's progress, keeps its note, guards its requests.

    Attributes:
        note: what is noted and not proven yet.
    """

    def __init__(
        self,
        job: Job,
        bus: Outlet,
        journal: Journal,
        guard: RequestGuard,
        clock: Clock,
        find_motors: Callable[[], Awaitable[bool | None]],
    ) -> None:
        self._job, self._bus, self._journal, self._guard = job, bus, journal, guard
        self._clock, self._find_motors = clock, find_motors
        self._last = Progress(0, 0, "begins")
        self.note: Note | None = None

    def progress(self, progress: Progress) -> None:
        """Publish how far it is."""
        self._last = progress
        self.publish(ProcedureState.RUNNING, progress.what)

    def publish(self, state: ProcedureState, text: str, token: str | None = None) -> ProcedureProgress:
        """Publish where it stands."""
        progress = ProcedureProgress(
            stamp=self._clock.stamp(),
            id=self._job.id,
            verb=self._job.verb,
            holder=self._job.holder,
            state=state,
            step=self._last.done,
            of=self._last.total,
            text=text,
            token=token,
        )
        self._bus.publish(KEY, progress)
        return progress

    async def live_set_at_risk(self, wanted: LiveSet) -> None:
        """Note what has to be live; nothing may change it before the note is on the disk.

        Raises:
            CommandRejectedError: `journal_unwritable`.
        """
        job = self._job
        note = Note(
            id=job.note_id,
            verb=job.verb,
            holder=job.holder,
            stamp=self._clock.stamp(),
            firmware=wanted.firmware,
            active=wanted.active,
            live=wanted.live,
            writing=dict(wanted.writing),
        )
        await self._journal.keep(note)
        self.note = note

    async def live_set_proven(self) -> None:
        """Forget the note.

        Raises:
            CommandRejectedError: `journal_unwritable`.
        """
        await self._journal.drop(self._job.note_id)
        self.note = None

    async def check(self, board: Board, message: WireMessage) -> None:
        """Let a request pass or refuse it.

        Raises:
            CommandRejectedError: what the guard says; `motors_started` where they were known to stand still before.
        """
        if self._job.is_alone and message.spec.danger and await self._find_motors() is not False:
            raise refuse(Token.MOTORS_STARTED, name=self._job.verb)
        await self._guard.check_step(board, message)

    async def prove(self, board: Board, message: WireMessage) -> None:
        """Make sure that the board asked is the one that hears us.

        Raises:
            CommandRejectedError: `board_unproven`, or what the link refuses.
        """
        await self._guard.prove_board(board, message)


def state_of(error: Exception) -> ProcedureState:
    """State of a procedure that ended with this error."""
    return ProcedureState.REFUSED if isinstance(error, CommandRejectedError) else ProcedureState.FAILED


def refusal_for(verb: str, error: Exception, link: Link) -> CommandRejectedError:
    """Refusal for an error that ended a procedure."""
    match error:
        case CommandRejectedError():
            return error
        case InterruptedProcedureError():
            return refuse(Token.CANCELLED, name=verb, detail="a client asked for it, or the daemon ends")
        case LinkLostError():
            condition = link.health().state.condition.value
            return refuse(Token.LINK_DOWN, state=condition, detail=str(error))
        case MkError():
            return refuse(Token.PROCEDURE_FAILED, name=verb, detail=str(error))
    _log.error("procedure failed", verb=verb, exc_info=error)
    return refuse(Token.INTERNAL, detail=f"{type(error).__name__}: {error}")
