"""`mkctl teleop`: fly with a gamepad, the keyboard, or a pad of another machine."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Coroutine, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from cyclopts import Parameter

from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.manoeuvre import ask_motors_to_stop
from mkdaemon.cli.mkctl.teleop.evdevpad import FoundPad, load_evdev, new_paths, open_pad
from mkdaemon.cli.mkctl.teleop.leasekeeper import LeaseKeeper
from mkdaemon.cli.mkctl.teleop.mappings import find_mapping, load_mappings
from mkdaemon.cli.mkctl.teleop.screen import drawing, screen_lines
from mkdaemon.cli.mkctl.teleop.session import Session
from mkdaemon.cli.mkctl.teleop.terminal import Keyboard, raw_terminal
from mkdaemon.cli.mkctl.teleop.watcher import Watcher
from mkdaemon.cli.printing import json_line
from mkdaemon.client import Vehicle
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section
from mkdaemon.control.teleop.keys import KEYBOARD
from mkdaemon.errors import ConfigError, MkError

LOOKING: Final = 0.5
"""Between two looks for pads that came [s]."""
DRAWING: Final = 0.2
"""Between two pictures of the screen [s]."""
TELLING: Final = 1.0
"""Between two lines where the output is no terminal [s]."""
_ENDS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


async def teleop(
    *,
    keyboard: Annotated[
        bool, Parameter(negative=(), help="Fly with the keys of this terminal, also over ssh.")
    ] = False,
    mapping: Annotated[Path | None, Parameter(help="Mapping file for every pad, in place of that of its id.")] = None,
    mode: Annotated[Literal[1, 2, 3, 4] | None, Parameter(help="Stick mode, in place of the mapping's.")] = None,
    list_: Annotated[
        bool, Parameter(name="--list", negative=(), help="Show the pads of this machine, and leave.")
    ] = False,
    force: Annotated[bool, Parameter(negative=(), help="Take the lease from whoever holds it.")] = False,
    connection: Connection = HERE,
) -> int:
    """Fly with a gamepad, or with the keyboard. Nothing is sent unless the dead-man is held: docs/teleop.md.

    Pull the thrust stick to its lowest once, then hold the dead-man. Letting go of it levels the aircraft at once and
    lets go of it after 0.9 s; a pad that is unplugged, or a terminal that is gone, lets go of it too. Ctrl-C ends it.

    Raises:
        ConfigError: a mapping is wrong, or a pad has none.
        MkError: no daemon, or no library for gamepads.
    """
    if list_:
        return _list(connection)
    if keyboard and not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("--keyboard needs a terminal, as `ssh -t` gives")
    if not keyboard:
        load_evdev()
    given = None if mapping is None else load_section(Gamepad, mapping)
    async with connection.open() as uav:
        if (absence := await uav.absence()) is not None:
            raise MkError(absence)
        keeper = LeaseKeeper(lambda: uav.lease(force=force))
        await _Program(uav, keeper, connection, given, mode, has_keyboard=keyboard).run()
    return 0


def _list(connection: Connection) -> int:
    """Show every pad of this machine, and which mapping it has."""
    known = load_mappings()
    found = [_describe(path) for path in new_paths(())]
    pads = [pad for pad in found if pad is not None]
    for pad in pads:
        name = next((mapping.name for _, mapping in known if pad.id in mapping.ids), None)
        if connection.json:
            print(
                json_line({"path": pad.path, "name": pad.name, "id": pad.id, "mapping": name, "trouble": pad.trouble})
            )
        else:
            words = pad.trouble or (f"mapping: {name}" if name else "no mapping: mkctl teleop --learn")
            print(f"{pad.path}  {pad.id}  {pad.name}  {words}")
    if not pads and not connection.json:
        print("no pad: plug one in; /dev/input/event* may want the group `input`")
    return 0


def _describe(path: str) -> FoundPad | None:
    """What a device file is; None where it is no gamepad."""
    try:
        pad = open_pad(path, lambda *_: None)
    except OSError as error:
        return FoundPad(path, "?", "", f"cannot be opened: {error.strerror}")
    if pad is None:
        return None
    pad.close()
    return FoundPad(path, pad.facts.name, pad.id)


class _Program:
    """Everything of one run of the program."""

    def __init__(
        self,
        uav: Vehicle,
        keeper: LeaseKeeper,
        connection: Connection,
        given: Gamepad | None,
        mode: Literal[1, 2, 3, 4] | None,
        *,
        has_keyboard: bool,
    ) -> None:
        self._uav, self._connection, self._given, self._mode = uav, connection, given, mode
        self._has_keyboard = has_keyboard
        self._stop = asyncio.Event()
        self._session = Session(keeper, self._stop_motors)
        self._watcher = Watcher()
        self._seen: set[str] = set()
        self._stopping: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Fly until a signal or a key ends it."""
        loop = asyncio.get_running_loop()
        for number in _ENDS:
            loop.add_signal_handler(number, self._stop.set)
        is_screen = sys.stdout.isatty() and not self._connection.json
        jobs: list[Coroutine[Any, Any, None]] = [
            self._watcher.run(self._uav, self._session.alarm),
            self._show(is_screen=is_screen),
        ]
        with ExitStack() as stack:
            if is_screen:
                stack.enter_context(_screen_of_its_own())
            if self._has_keyboard:
                stack.enter_context(raw_terminal(sys.stdin.fileno()))
                keyboard = Keyboard(sys.stdin.fileno(), sys.stdout, self._stop.set, self._session.reported)
                self._session.attach(keyboard, KEYBOARD)
            else:
                jobs.append(self._look_for_pads())
            await self._run_beside(jobs)
        if self._has_keyboard and "keyboard" not in self._session.devices:
            raise MkError(self._session.notice)
        print(f"ended: {self._session.notice}", file=sys.stderr)

    async def _run_beside(self, jobs: list[Coroutine[Any, Any, None]]) -> None:
        """Run the session; what fails beside it ends it in order."""
        try:
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(job, name="teleop") for job in jobs]
                await self._session.run(self._stop)
                for task in tasks:
                    task.cancel()
        except BaseExceptionGroup as failures:
            known = failures.subgroup(MkError)
            if known is None:
                raise
            raise known.exceptions[0] from None

    def _with_mode(self, pad: Gamepad) -> Gamepad:
        return pad if self._mode is None else pad.model_copy(update={"mode": self._mode})

    async def _look_for_pads(self) -> None:
        known = load_mappings()
        while True:
            present = set(new_paths(()))
            self._seen &= present
            for path in sorted(present - self._seen):
                self._seen.add(path)
                try:
                    pad = open_pad(path, self._session.reported)
                    if pad is not None:
                        mapping = self._given or find_mapping(pad.id, pad.facts.name, known)
                        self._session.attach(pad, self._with_mode(mapping))
                except OSError as error:
                    self._session.notice = f"{path}: {error.strerror}; is this user in the group `input`?"
                except ConfigError as error:
                    self._session.notice = str(error)
            await asyncio.sleep(LOOKING)

    async def _show(self, *, is_screen: bool) -> None:
        """Draw the screen just after a tick, when the next one is farthest; without a terminal, write lines."""
        title = f"{self._connection.vehicle} at {self._connection.connect}"
        color = "NO_COLOR" not in os.environ and os.environ.get("TERM", "dumb") != "dumb"
        last = ""
        while True:
            self._session.ticked.clear()
            await self._session.ticked.wait()
            self._session.is_on_ground = self._watcher.is_on_ground
            if is_screen:
                lines = screen_lines(self._session, self._watcher, title, has_keyboard=self._has_keyboard)
                sys.stdout.write(drawing(lines, color=color))
                sys.stdout.flush()
            elif (line := self._line()) != last:
                print(line, flush=True)
                last = line
            await asyncio.sleep(DRAWING if is_screen else TELLING)

    def _line(self) -> str:
        output = self._session.output
        wanted = output.setpoint
        if not self._connection.json:
            return output.reason
        fields = None if wanted is None else {"kind": wanted.kind, **wanted.fields}
        return json_line({"reason": output.reason, "setpoint": fields, "engaged": self._session.keeper.is_engaged})

    def _stop_motors(self) -> None:
        """Ask for the motors to stop, beside the stream."""

        async def ask() -> None:
            try:
                await ask_motors_to_stop(self._uav, in_flight=False)
                self._session.notice = "motors: asked to stop; only telemetry tells whether they stand"
            except MkError as error:
                self._session.notice = str(error)

        self._stopping = asyncio.create_task(ask(), name="teleop stop")


@contextmanager
def _screen_of_its_own() -> Iterator[None]:
    """Draw on the terminal's second screen; the first comes back afterwards."""
    sys.stdout.write("\x1b[?1049h\x1b[?25l\x1b[2J")
    try:
        yield
    finally:
        sys.stdout.write("\x1b[?25h\x1b[?1049l")
        sys.stdout.flush()
