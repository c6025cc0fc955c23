"""A bar for a procedure that the daemon runs, and Ctrl-C for it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from mkdaemon.cli.console import progress_bars
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
    running: list[str] = []
    with progress_bars(title, "{task.percentage:3.0f} %", "{task.description}", quiet=quiet) as bars:
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
