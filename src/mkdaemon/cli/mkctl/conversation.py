"""Drives procedures of the protocol over Zenoh queries: each request is a query, each answer a message again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final, Protocol, TypeVar

from mkdaemon.client import Answer
from mkdaemon.client.samples import message_from
from mkdaemon.errors import MkError, ProtocolError
from mkdaemon.protocol.procedures.steps import Ask, Pause, Procedure, Progress, Step
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.tokens import Status

_Result = TypeVar("_Result")
_TRY_AGAIN: Final = frozenset({Status.TIMEOUT, Status.BUSY})
"""Ends of a query after which the procedure itself may ask again."""
_BUSY_WAIT: Final = 0.2
"""Before asking again what the daemon was too busy for [s]."""

Report = Callable[[Progress], None]
"""Shows how far a procedure is."""


class Commander(Protocol):
    """What is needed of a client."""

    async def command(self, target: str, name: str, fields: Mapping[str, Any] | None = None) -> Answer:
        """Ask a board something."""


async def converse(
    client: Commander, procedure: Procedure[_Result], report: Report | None = None, *, confirm: bool = True
) -> _Result:
    """Run a procedure to its end.

    An interruption (Ctrl-C) is handed to the procedure once, so that it can leave the board as it was; then it ends.

    Args:
        client: the daemon's client.
        procedure: what to do.
        report: shows progress.
        confirm: answer the daemon's question for confirmation of dangerous requests.

    Raises:
        MkError: whatever the procedure or the daemon raised.
        ProtocolError: the procedure took no step.
    """
    step = next(procedure, None)
    while step is not None:
        try:
            answer = await _take(client, step, report, confirm)
        except MkError as error:
            move = _thrower(procedure, error)
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if task is not None:
                task.uncancel()
            move = _thrower(procedure, MkError("interrupted"))
        else:
            move = _sender(procedure, answer)
        try:
            step = move()
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]  # a generator's value is untyped at run time
    msg = "a procedure ended before it began"
    raise ProtocolError(msg)


def _sender(procedure: Procedure[_Result], answer: WireMessage | None) -> Callable[[], Step]:
    return lambda: procedure.send(answer)


def _thrower(procedure: Procedure[_Result], error: MkError) -> Callable[[], Step]:
    return lambda: procedure.throw(error)


async def _take(client: Commander, step: Step, report: Report | None, confirm: bool) -> WireMessage | None:
    """Do one step; the answer to a request, if it has one that fits."""
    if isinstance(step, Progress):
        if report is not None:
            report(step)
        return None
    if isinstance(step, Pause):
        await asyncio.sleep(step.seconds)
        return None
    if not isinstance(step, Ask):
        return None
    answer = await request(client, step.board, step.message, confirm=confirm)
    return answer if answer is not None and step.accepts(answer) else None


async def request(client: Commander, board: Board, message: WireMessage, *, confirm: bool = True) -> WireMessage | None:
    """Send one request through the daemon and return the answer as a message; None where none came in time.

    Where the user has asked for what the message does, the daemon's question for confirmation is answered here.

    Raises:
        CommandRejectedError: the daemon refused it; says token, reason and fix.
        MkError: no daemon.
    """
    fields = message.model_dump()
    if message.spec.danger and confirm:
        fields["confirm"] = True
    answer = await client.command(board.word, message.spec.key, fields)
    if answer.status == Status.BUSY:
        await asyncio.sleep(_BUSY_WAIT)
    if answer.status in _TRY_AGAIN:
        return None
    return message_from(answer.reply_type, answer.require())


@contextmanager
def progress_bar(title: str, *, quiet: bool = False) -> Iterator[Report]:
    """Show a bar on standard error while the context lives; nothing when `quiet` or no terminal is there."""
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bars

    console = Console(stderr=True)
    columns = (TextColumn(title), BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"))
    with Bars(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bars:
        task = bars.add_task("", total=None)
        yield lambda progress: bars.update(
            task, total=progress.total, completed=progress.done, description=progress.what
        )
