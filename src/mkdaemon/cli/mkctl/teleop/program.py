"""One run of `mkctl teleop`: the session, what stands beside it, the terminal, the ends."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final

from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.teleop.leasekeeper import LeaseKeeper
from mkdaemon.cli.mkctl.teleop.screen import drawing, screen_lines
from mkdaemon.cli.mkctl.teleop.session import Session
from mkdaemon.cli.mkctl.teleop.terminal import Keyboard, raw_terminal
from mkdaemon.cli.mkctl.teleop.watcher import Watcher
from mkdaemon.cli.printing import json_line
from mkdaemon.client import Vehicle
from mkdaemon.control.teleop.keys import KEYBOARD
from mkdaemon.errors import MkError

DRAWING: Final = 0.2
"""Between two pictures of the screen [s]."""
TELLING: Final = 1.0
"""Between two lines where the output is no terminal [s]."""
_ENDS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

Job = Coroutine[Any, Any, None]


@dataclass(frozen=True, slots=True)
class Source:
    """Where the devices of a run come from.

    Attributes:
        start: makes what attaches them to the session; None for nothing beside the keyboard.
        has_keyboard: the keys of this terminal fly.
        ends_with_devices: the run is over when `start` is.
    """

    start: Callable[[Session, Vehicle], Job] | None = None
    has_keyboard: bool = False
    ends_with_devices: bool = False


class Program:
    """Everything of one run.

    Attributes:
        session: devices, teleop, lease.
    """

    def __init__(self, uav: Vehicle, connection: Connection, source: Source, *, force: bool) -> None:
        self._uav, self._connection, self._source = uav, connection, source
        self._stop = asyncio.Event()
        self.session = Session(LeaseKeeper(lambda: uav.lease(force=force)), self._stop_motors)
        self._watcher = Watcher()
        self._stopping: asyncio.Task[None] | None = None

    async def run(self, *beside: Job) -> None:
        """Fly until a signal, a key, or the end of a recording.

        Args:
            beside: what runs meanwhile; its failure ends the run.

        Raises:
            MkError: what stands beside the session failed, or the keyboard is gone.
        """
        loop = asyncio.get_running_loop()
        for number in _ENDS:
            loop.add_signal_handler(number, self._stop.set)
        is_screen = sys.stdout.isatty() and not self._connection.json
        jobs: list[Job] = [*beside, self._watcher.run(self._uav, self._alarm), self._show(is_screen=is_screen)]
        if self._source.start is not None:
            jobs.append(self._supply(self._source.start(self.session, self._uav)))
        with ExitStack() as stack:
            if is_screen:
                stack.enter_context(_second_screen())
            if self._source.has_keyboard:
                stack.enter_context(raw_terminal(sys.stdin.fileno()))
                keyboard = Keyboard(sys.stdin.fileno(), sys.stdout, self._stop.set, self.session.reported)
                self.session.attach(keyboard, KEYBOARD)
            await self._run_beside(jobs)
        if self._source.has_keyboard and "keyboard" not in self.session.devices:
            raise MkError(self.session.notice)
        print(f"ended: {self.session.notice}", file=sys.stderr)

    async def _supply(self, job: Job) -> None:
        await job
        if self._source.ends_with_devices:
            self._stop.set()

    async def _run_beside(self, jobs: list[Job]) -> None:
        """Run the session; what fails beside it ends it in order."""
        try:
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(job, name="teleop") for job in jobs]
                await self.session.run(self._stop)
                for task in tasks:
                    task.cancel()
        except BaseExceptionGroup as failures:
            known = failures.subgroup(MkError)
            if known is None:
                raise
            raise known.exceptions[0] from None

    async def _show(self, *, is_screen: bool) -> None:
        """Draw the screen just after a tick, when the next one is farthest; without a terminal, write lines."""
        title = f"{self._connection.vehicle} at {self._connection.connect}"
        color = "NO_COLOR" not in os.environ and os.environ.get("TERM", "dumb") != "dumb"
        last = ""
        while True:
            self.session.ticked.clear()
            await self.session.ticked.wait()
            self.session.is_on_ground = self._watcher.is_on_ground
            if is_screen:
                lines = screen_lines(self.session, self._watcher, title, has_keyboard=self._source.has_keyboard)
                with suppress(OSError):  # a terminal that was hung up; SIGHUP ends the program
                    sys.stdout.write(drawing(lines, color=color))
                    sys.stdout.flush()
            elif (line := self._line()) != last:
                print(line, flush=True)
                last = line
            await asyncio.sleep(DRAWING if is_screen else TELLING)

    def _alarm(self, notice: str) -> None:
        """Shake the pads, and ring the bell of the terminal."""
        self.session.alarm(notice)
        if sys.stdout.isatty() and not self._source.has_keyboard:
            sys.stdout.write("\a")

    def _line(self) -> str:
        output = self.session.output
        wanted = output.setpoint
        if not self._connection.json:
            return f"{output.reason} ({self.session.notice})"
        fields = None if wanted is None else {"kind": wanted.kind, **wanted.fields}
        return json_line({"reason": output.reason, "setpoint": fields, "engaged": self.session.keeper.is_engaged})

    def _stop_motors(self) -> None:
        """Ask for the motors to stop, beside the stream."""

        async def ask() -> None:
            try:
                await self._uav.stop()
                self.session.notice = "motors: asked to stop; only telemetry tells whether they stand"
            except MkError as error:
                self.session.notice = str(error)

        self._stopping = asyncio.create_task(ask(), name="teleop stop")


@contextmanager
def _second_screen() -> Iterator[None]:
    """Draw on the terminal's second screen; the first comes back afterwards."""
    sys.stdout.write("\x1b[?1049h\x1b[?25l\x1b[2J")
    try:
        yield
    finally:
        with suppress(OSError):
            sys.stdout.write("\x1b[?25h\x1b[?1049l")
            sys.stdout.flush()
