"""Takes requests for procedures and runs them, one at a time; a client that dies meanwhile changes nothing.

The client waits for the end; the run itself belongs to the daemon. On an orderly exit a procedure gets a moment to
leave the board as it promises to; what it cannot finish stays in the journal and is done at the next start.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, Final

from mkdaemon.bus.codec import Payload, read_command, schema_name
from mkdaemon.clock import Clock
from mkdaemon.control.admission.beginnings import Procedure
from mkdaemon.control.events import Feed, ListChanged
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.daemon.audit import Audit, Outlet
from mkdaemon.daemon.discovery import require_discovery
from mkdaemon.daemon.procedures.interlock import Interlock
from mkdaemon.daemon.procedures.job import Job, JobObserver, RequestGuard, refusal_for, state_of
from mkdaemon.daemon.procedures.journal import Journal, Note
from mkdaemon.daemon.procedures.lists import WaypointListKeeper
from mkdaemon.daemon.procedures.make import PATIENCE
from mkdaemon.daemon.procedures.recovery import Recovery
from mkdaemon.daemon.procedures.table import PROCEDURES, ProcedureSpec, request_model
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.labels import LabelCache, read_labels
from mkdaemon.link.link import Link
from mkdaemon.link.procedures import InterruptedProcedureError, Observer, run_procedure
from mkdaemon.protocol.procedures.live_set import recover_live_set
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.command import CommandResult, Labels, LabelsRequest
from mkdaemon.telemetry.mission import (
    RouteStarted,
    WaypointsStored,
    WaypointsUploadRequest,
)
from mkdaemon.telemetry.procedure import Cancelled, CancelRequest, InFlightRequest, ProcedureState
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.settings import OwedSets, SettingsRecoverRequest
from mkdaemon.telemetry.state import Position
from mkdaemon.telemetry.status import Status

LEAVE: Final = 1.0
"""Longest time a procedure gets to leave the board on an orderly exit [s]; the whole daemon must be gone within two."""
LOOK: Final = 0.2
"""Time between two looks at a live set that is owed [s]."""
MOTORS_WAIT: Final = 3.0
"""How long to wait for telemetry that tells whether the motors run [s]."""


class ProcedureRunner:
    """Runs procedures; everything happens on the loop."""

    def __init__(
        self,
        link: Link,
        facts: VehicleFacts,
        feed: Feed,
        bus: Outlet,
        audit: Audit,
        guard: RequestGuard,
        interlock: Interlock,
        journal: Journal,
        labels: LabelCache,
        clock: Clock,
    ) -> None:
        """Read what an earlier daemon left in the journal; `run` does the work."""
        self._link, self._facts, self._feed, self._bus, self._audit = link, facts, feed, bus, audit
        self._guard, self._interlock, self._journal, self._labels = guard, interlock, journal, labels
        self._clock = clock
        self._list = WaypointListKeeper(journal, audit, bus, clock)
        self._recovery = Recovery(journal, link, facts, audit, interlock)
        self._job: Job | None = None
        self._news = asyncio.Event()

    @property
    def verbs(self) -> dict[str, Callable[[Payload], Awaitable[CommandResult]]]:
        """Requests under `do/`, each with its handler."""
        return {
            **{verb: partial(self._answer, verb, spec) for verb, spec in PROCEDURES.items()},
            "labels": self._answer_labels,
            "cancel": self._cancel,
            "settings_recover": self._recover,
        }

    async def run(self) -> None:
        """Carry out what is asked for, and what an earlier daemon left."""
        self._list.announce()
        while True:
            await self._carry_out(await self._next_job())

    # -- what clients ask for -------------------------------------------------------------------------------------

    async def _answer(self, verb: str, spec: ProcedureSpec, payload: Payload) -> CommandResult:
        model = request_model(verb)
        request = read_command(model, payload)
        is_alone = (spec.is_alone and not request.allows_flight) or self._is_behind(spec.board)
        wanted = Procedure(
            verb=verb,
            is_alone=is_alone,
            needs_live_set=spec.needs_live_set,
            can_fly=issubclass(model, InFlightRequest),
            unconfirmed="" if request.is_confirmed else spec.writes or f"do/{verb} writes",
        )
        self._interlock.require(replace(wanted, is_early=True))
        await require_discovery(self._link, self._facts.link)
        flown = spec.begins(request)
        if flown is not None:
            self._interlock.require(flown)
        prepared = spec.prepare(request, self._facts.newest(Position, self._clock.now()))
        if is_alone:
            await self._find_motors()
        self._interlock.require(wanted)

        async def work(observer: Observer) -> Telemetry:
            source = request.source if isinstance(request, WaypointsUploadRequest) else ""
            writes = self._list.watch(observer, verb, request.holder, source) if spec.changes_list else None
            try:
                reply = await run_procedure(self._link, spec.make(prepared), writes or observer)
            except Exception:
                if writes is not None and writes.may_be_changed:
                    self._list.broke_off(source)
                raise
            if writes is not None:
                self._feed(ListChanged(), self._clock.now())
            if isinstance(reply, WaypointsStored):
                await self._list.stored(reply, source)
            elif isinstance(reply, RouteStarted):
                self._list.publish("started", count=reply.count)
            return reply

        reply = await self._queue(Job(verb, request.holder, work, is_alone))
        return CommandResult(status=Status.ACCEPTED, reply=dict(reply), reply_type=schema_name(type(reply)))

    def _is_behind(self, board: Board) -> bool:
        """Whether a NaviCtrl must pass the line through to a board, which stops its telemetry."""
        return self._link.direct_board is Board.NC and board is not Board.NC

    async def _answer_labels(self, payload: Payload) -> CommandResult:
        """Answer `do/labels` from what is kept for this firmware, or from the board itself."""
        request = read_command(LabelsRequest, payload)
        board = Board[request.board.upper()]
        kept = self._labels.find_for(board, self._link.dialect)
        if kept is None:
            is_behind = self._is_behind(board)
            self._interlock.require(Procedure(verb="labels", is_alone=is_behind, is_early=True))

            async def work(observer: Observer) -> tuple[str, ...]:
                return await read_labels(self._link, board, self._labels, observer)

            kept = await self._queue(Job("labels", "", work, is_behind))
        reply = Labels(board=request.board, names=kept)
        return CommandResult(status=Status.ACCEPTED, reply=dict(reply), reply_type=schema_name(Labels))

    async def _cancel(self, payload: Payload) -> CommandResult:
        request = read_command(CancelRequest, payload)
        job = self._job
        if job is None or job.task is None or request.id not in {None, job.id}:
            raise refuse(Token.NO_PROCEDURE)
        job.cancel()
        await asyncio.wait({job.done})
        return CommandResult(
            status=Status.ACCEPTED, reply={"id": job.id, "verb": job.verb}, reply_type=schema_name(Cancelled)
        )

    async def _recover(self, payload: Payload) -> CommandResult:
        request = read_command(SettingsRecoverRequest, payload)
        if not request.is_confirmed:
            detail = "whatever is live stays live"
            raise refuse(Token.NOT_CONFIRMED, name="do/settings_recover", detail=detail, confirm=True)
        if request.action == "retry":
            self._recovery.retry()
            self._news.set()
        elif request.action == "discard":
            for note in tuple(self._recovery.notes):
                await self._journal.drop(note.id)
                self._recovery.forget(note)
        reply = OwedSets(notes=self._recovery.list_notes())
        return CommandResult(status=Status.ACCEPTED, reply=dict(reply), reply_type=schema_name(OwedSets))

    async def _find_motors(self) -> bool | None:
        """Whether motors run; waits a while for telemetry to tell, which pauses while a board is deaf."""
        with suppress(TimeoutError):
            async with asyncio.timeout(MOTORS_WAIT):
                # Telemetry is a state, not an event.
                while self._facts.motors_running(self._clock.now()) is None:  # noqa: ASYNC110
                    await asyncio.sleep(0.05)
        return self._facts.motors_running(self._clock.now())

    # -- running --------------------------------------------------------------------------------------------------

    async def _queue(self, job: Job) -> Any:
        """Hand a job to `run` and wait for its end; who stops waiting does not stop it."""
        observer = self._observe(job)
        self._job, self._interlock.is_alone = job, job.is_alone
        self._interlock.running = observer.publish(ProcedureState.RUNNING, "begins")
        self._news.set()
        return await asyncio.shield(job.done)

    def _observe(self, job: Job) -> JobObserver:
        return JobObserver(job, self._bus, self._journal, self._guard, self._clock, self._find_motors)

    async def _next_job(self) -> Job:
        """Wait for a client's job, or for the moment when a live set that is owed can be restored."""
        while self._job is None:
            note = self._recovery.next_note(self._clock.now())
            if note is not None and self._may_recover():
                job = Job("recovery", "mkdaemon", partial(self._restore, note), is_alone=True, note_id=note.id)
                self._job, self._interlock.is_alone = job, True
                self._interlock.running = self._observe(job).publish(ProcedureState.RUNNING, "begins")
                break
            self._news.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(LOOK if self._recovery.notes else None):
                    await self._news.wait()
        return self._job

    def _may_recover(self) -> bool:
        return self._interlock.refusal(Procedure(verb="recovery", is_alone=True, is_early=True)) is None

    async def _restore(self, note: Note, observer: Observer) -> None:
        found = await run_procedure(self._link, recover_live_set(note.wanted, PATIENCE), observer)
        self._recovery.attempt_ended(note, found)

    async def _carry_out(self, job: Job) -> None:
        observer = self._observe(job)
        job.task = asyncio.create_task(self._work(job, observer), name=f"procedure {job.verb}")
        try:
            await asyncio.wait({job.task})
        except asyncio.CancelledError:
            job.cancel()
            await asyncio.wait({job.task}, timeout=LEAVE)
            job.task.cancel()
            await asyncio.wait({job.task})
            raise
        finally:
            if not job.done.done():
                self._fail(job, observer, InterruptedProcedureError("it was stopped at its present step"))

    def _free_line(self, job: Job) -> None:
        """Let the next procedure start, before the waiting client gets the end and may ask for it."""
        if self._job is job:
            self._job, self._interlock.running, self._interlock.is_alone = None, None, False

    async def _work(self, job: Job, observer: JobObserver) -> None:
        """Run a job to its end, success or failure; the end is published before the waiting client gets it."""
        try:
            result = await job.work(observer)
        except Exception as error:  # noqa: BLE001
            # One client's strange request must not end the flight of another: answer, log, go on.
            self._fail(job, observer, error)
        else:
            observer.publish(ProcedureState.DONE, "done")
            self._settle(job, observer, None)
            self._free_line(job)
            job.done.set_result(result)

    def _fail(self, job: Job, observer: JobObserver, error: Exception) -> None:
        """Publish why a job has no result, keep what it left unproven, and answer."""
        refusal = refusal_for(job.verb, error, self._link)
        observer.publish(state_of(error), f"{refusal.reason} {refusal.fix}", refusal.token)
        self._settle(job, observer, refusal)
        self._free_line(job)
        job.done.set_exception(refusal)

    def _settle(self, job: Job, observer: JobObserver, refusal: CommandRejectedError | None) -> None:
        """Whatever was left unproven is the recovery's from now on."""
        if observer.note is not None:
            self._recovery.add(observer.note)
        owed = self._interlock.owed
        if refusal is not None and owed is not None and owed.id == job.note_id and observer.note is None:
            self._recovery.attempt_failed(owed, refusal.reason, self._clock.now())
