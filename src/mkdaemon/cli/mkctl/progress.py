"""A bar for a procedure that the daemon runs, and Ctrl-C for it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from mkdaemon.cli.terminal import on_one_line
from mkdaemon.client import Vehicle
from mkdaemon.client.asking import OnProgress
from mkdaemon.errors import MkError
from mkdaemon.telemetry.procedure import ProcedureProgress


@asynccontextmanager
async def showing_progress(uav: Vehicle, title: str, *, quiet: bool = False) -> AsyncIterator[OnProgress]:
    """Show a bar on standard error while the context lives; nothing when `quiet` or no terminal is there.

    Ctrl-C ends the procedure too, and the procedure leaves the board in the state that it documents. Killing this
    program ends only the bar.
    """
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    from mkdaemon.cli.console import Console

    running: list[str] = []
    console = Console(stderr=True)
    columns = (TextColumn(title), BarColumn(), TaskProgressColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bars:
        task = bars.add_task("", total=None)

        def show(progress: ProcedureProgress) -> None:
            running[:] = [progress.id]
            bars.update(
                task, total=progress.of or None, completed=progress.step, description=on_one_line(progress.text)
            )

        try:
            yield show
        except asyncio.CancelledError:
            if running:
                with suppress(MkError):
                    await uav.cancel(running[0])
            raise
