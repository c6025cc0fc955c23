"""`mkctl teleop`: fly with a gamepad, the keyboard, or a pad of another machine."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import sys
from collections.abc import Callable, Coroutine
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from secrets import token_hex
from typing import Annotated, Any, Final, Literal, TextIO

from cyclopts import Parameter
from rich.console import Group
from rich.live import Live

from mkdaemon.cli.console import Console
from mkdaemon.cli.keyreader import raw_terminal
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.teleop.evdevpad import load_evdev
from mkdaemon.cli.mkctl.teleop.joypad import look_for_joy, publish_pad
from mkdaemon.cli.mkctl.teleop.keyboard import Keyboard
from mkdaemon.cli.mkctl.teleop.mappings import Learner, load_mappings, save_mapping
from mkdaemon.cli.mkctl.teleop.padrecording import PadRecorder, read_recording
from mkdaemon.cli.mkctl.teleop.padreplay import feed, require_simulator, watch_simulator
from mkdaemon.cli.mkctl.teleop.padsearch import Mappings, describe_pads, look_for_pads, only_pad
from mkdaemon.cli.mkctl.teleop.screen import screen_lines
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.cli.mkctl.teleop.watcher import Watcher
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.terminal import drawing_stream
from mkdaemon.client import Vehicle
from mkdaemon.client.joy import JoySender
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.client.taskerrors import beside
from mkdaemon.client.teleop.keys import KEYBOARD
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.gamepadfiles import own_folder
from mkdaemon.config.reader import load_section
from mkdaemon.errors import ConfigError, MkError

SECRET: Final = "MK_JOY_SECRET"
"""Environment variable with the secret of `--joy` and `--publish`."""
_PAD: Final = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class InputOptions:
    """With what is flown; gamepads of this machine unless one of these is given."""

    keyboard: bool = False
    """The keys of this terminal, also over ssh."""
    joy: str | None = None
    """A pad of another machine, by the name under which `--publish` sends it there."""
    replay: Path | None = None
    """A recorded session, into a simulator."""
    mapping: Path | None = None
    """Mapping file of every pad, in place of that of its id."""
    mode: Literal[1, 2, 3, 4] | None = None
    """Stick mode, in place of the mapping's."""


PADS: Final = InputOptions()


async def teleop(
    *,
    hands: InputOptions = PADS,
    list_: Annotated[bool, Parameter(name="--list", help="List the gamepads of this machine.")] = False,
    learn: Annotated[bool, Parameter(help="Write a mapping for the connected gamepad.")] = False,
    publish: Annotated[str | None, Parameter(help="Do not fly; send this machine's pad to `--joy NAME`.")] = None,
    record: Annotated[Path | None, Parameter(help="Record the session for --replay.")] = None,
    force: Annotated[bool, Parameter(help="Take the lease from its holder.")] = False,
    connection: Connection = HERE,
) -> int:
    """Fly with a gamepad, or with the keyboard. Nothing is sent unless the enable button is held: docs/teleop.md.

    Pull the thrust stick to its lowest once, then hold the enable button. If you let the button go,
    the aircraft levels at once and is released after 0.9 s. It is also released if the pad is unplugged or the terminal
    closes. Ctrl-C ends it.

    Example: mkctl teleop --keyboard

    Raises:
        ConfigError: a mapping or a recording is wrong, options do not go together, or a pad has no mapping.
        MkError: no daemon, no library for gamepads, no pad, or no simulator for a recording.
    """
    _check(hands)
    if list_:
        return _list(connection)
    if learn:
        return await _learn()
    if publish is not None:
        return await _publish(publish, connection)
    lines = None if hands.replay is None else read_recording(hands.replay)
    given = None if hands.mapping is None else load_section(Gamepad, hands.mapping)
    mappings = Mappings(given, hands.mode)
    if not (hands.keyboard or hands.joy or lines):
        load_evdev()
    secret = os.environ.get(SECRET) or token_hex(8)
    with ExitStack() as stack:
        file = None if record is None else stack.enter_context(_open_new(record))
        async with connection.open() as uav:
            if (absence := await uav.absence()) is not None:
                raise MkError(absence)
            if lines is not None:
                await require_simulator(uav)
                source = DeviceSource(lambda session, _: feed(session, lines), ends_with_devices=True)
            elif hands.joy is not None:
                pad = hands.joy
                source = DeviceSource(lambda session, client: look_for_joy(session, client, pad, secret, mappings))
                print(f"on the machine of the pad: {SECRET}={secret} mkctl teleop --publish {pad}", file=sys.stderr)
            elif hands.keyboard:
                source = DeviceSource(has_keyboard=True)
            else:
                source = DeviceSource(lambda session, _: look_for_pads(session, mappings))
            program = TeleopProgram(uav, connection, source, force=force)
            if file is not None:
                program.session.recorder = PadRecorder(file, program.session.now)
            if hands.joy is not None:
                program.session.notice = f"waits for {SECRET}={secret} mkctl teleop --publish {hands.joy}"
            await program.run(*([watch_simulator(uav)] if lines is not None else []))
    return 0


def _check(hands: InputOptions) -> None:
    """Refuse options that do not go together.

    Raises:
        ConfigError: says which.
    """
    chosen = [f"--{name}" for name in ("keyboard", "joy", "replay") if getattr(hands, name)]
    if len(chosen) > 1:
        raise ConfigError(f"{' and '.join(chosen)} do not go together: give one")
    if hands.keyboard and not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("--keyboard needs a terminal, as `ssh -t` gives")
    if hands.joy is not None:
        _require_pad_name(hands.joy, "--joy")


def _require_pad_name(name: str, option: str) -> None:
    if _PAD.fullmatch(name) is None:
        raise ConfigError(f"{option} {name!r}: a name has lower-case letters, digits, - and _")


def _open_new(path: Path) -> TextIO:
    """Open a file that does not exist yet.

    Raises:
        ConfigError: it exists, or cannot be written.
    """
    try:
        return path.open("x", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--record {path}: {error.strerror}") from error


def _list(connection: Connection) -> int:
    """Show every pad of this machine, and which mapping it has."""
    known = load_mappings()
    pads = list(describe_pads())
    for pad in pads:
        name = next((mapping.name for _, mapping in known if pad.id in mapping.ids), None)
        if connection.json:
            shown = {"path": pad.path, "name": pad.name, "id": pad.id, "mapping": name, "trouble": pad.trouble}
            print(json_line(shown))
        else:
            words = pad.trouble or (f"mapping: {name}" if name else "no mapping: mkctl teleop --learn")
            print(f"{pad.path}  {pad.id}  {pad.name}  {words}")
    if not pads and not connection.json:
        print("no pad: plug one in; /dev/input/event* may want the group `input`")
    return 0


async def _learn() -> int:
    """Ask for every stick and button of the pad, and write its mapping.

    Raises:
        MkError: no pad, or not everything was shown.
    """
    pad = only_pad(asyncio.Event())
    try:
        text = await Learner(pad, pad.id, lambda line: print(line, flush=True)).learn()
        path = save_mapping(own_folder(), pad.facts.name, text)
    finally:
        pad.close()
    print(f"wrote {path}; rates, expo, trims and the hover thrust may be set there: docs/teleop.md")
    return 0


async def _publish(name: str, connection: Connection) -> int:
    """Send this machine's pad to a program that flies.

    Raises:
        ConfigError: the name, or no secret.
        MkError: no pad, or no daemon at the endpoint.
    """
    _require_pad_name(name, "--publish")
    secret = os.environ.get(SECRET)
    if not secret:
        raise ConfigError(f"--publish needs {SECRET}: `mkctl teleop --joy {name}` shows it where it flies")
    news = asyncio.Event()
    pad = only_pad(news)
    try:
        async with connection.open() as uav:
            await publish_pad(pad, pad.id, JoySender(uav, name, secret), news, lambda line: print(line, flush=True))
    finally:
        pad.close()
    return 0


DRAWING: Final = 0.2
"""Between two pictures of the screen [s]."""
TELLING: Final = 1.0
"""Between two lines where the output is not a terminal [s]."""
_ENDS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

Job = Coroutine[Any, Any, None]


@dataclass(frozen=True, slots=True)
class DeviceSource:
    """Where the devices of a run come from.

    Attributes:
        start: makes what attaches them to the session; None for nothing beside the keyboard.
        has_keyboard: the keys of this terminal fly.
        ends_with_devices: the run is over when `start` is.
    """

    start: Callable[[TeleopSession, Vehicle], Job] | None = None
    has_keyboard: bool = False
    ends_with_devices: bool = False


class TeleopProgram:
    """Everything of one run.

    Attributes:
        session: devices, teleop, lease.
    """

    def __init__(self, uav: Vehicle, connection: Connection, source: DeviceSource, *, force: bool) -> None:
        self._uav, self._connection, self._source = uav, connection, source
        self._stop = asyncio.Event()
        self.session = TeleopSession(LeaseKeeper(partial(uav.lease, force=force)), self._stop_motors)
        self._watcher = Watcher()
        self._stopping: asyncio.Task[None] | None = None

    async def run(self, *others: Job) -> None:
        """Fly until a signal, a key, or the end of a recording.

        Args:
            others: what runs meanwhile; its failure ends the run.

        Raises:
            MkError: what stands beside the session failed, or the keyboard is gone.
        """
        loop = asyncio.get_running_loop()
        for number in _ENDS:
            loop.add_signal_handler(number, self._stop.set)
        is_screen = sys.stdout.isatty() and not self._connection.json
        show = self._draw if is_screen else self._write_lines
        jobs: list[Job] = [*others, self._watcher.run(self._uav, self._alarm), show()]
        if self._source.start is not None:
            jobs.append(self._supply(self._source.start(self.session, self._uav)))
        with ExitStack() as stack:
            if self._source.has_keyboard:
                stack.enter_context(raw_terminal(sys.stdin.fileno()))
                screen = drawing_stream(sys.stdout)
                keyboard = Keyboard(sys.stdin.fileno(), screen, self._stop.set, self.session.reported)
                self.session.attach(keyboard, KEYBOARD)
            async with beside(*jobs):
                await self.session.run(self._stop)
        if self._source.has_keyboard and "keyboard" not in self.session.devices:
            raise MkError(self.session.notice)
        print(f"ended: {self.session.notice}", file=sys.stderr)

    async def _supply(self, job: Job) -> None:
        await job
        if self._source.ends_with_devices:
            self._stop.set()

    async def _next_tick(self) -> None:
        """Wait for the end of a tick, when the next one is farthest."""
        self.session.ticked.clear()
        await self.session.ticked.wait()
        self.session.is_on_ground = self._watcher.is_on_ground

    async def _draw(self) -> None:
        """Draw the screen, for ever; the one before comes back afterwards."""
        title = f"{self._connection.vehicle} at {self._connection.connect}"
        screen = Live(console=Console(), screen=True, auto_refresh=False, redirect_stdout=False, redirect_stderr=False)
        with suppress(OSError), screen:  # a terminal that was hung up; SIGHUP ends the program
            while True:
                await self._next_tick()
                lines = screen_lines(self.session, self._watcher, title, has_keyboard=self._source.has_keyboard)
                screen.update(Group(*lines), refresh=True)
                await asyncio.sleep(DRAWING)

    async def _write_lines(self) -> None:
        """Write what changes, for ever: the output is not a terminal."""
        last = ""
        while True:
            await self._next_tick()
            if (line := self._line()) != last:
                print(line, flush=True)
                last = line
            await asyncio.sleep(TELLING)

    def _alarm(self, notice: str) -> None:
        """Shake the pads, and ring the bell of the terminal."""
        self.session.alarm(notice)
        if sys.stdout.isatty() and not self._source.has_keyboard:
            drawing_stream(sys.stdout).write("\a")

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
                self.session.notice = "motors: asked to stop; only telemetry shows whether they have stopped"
            except MkError as error:
                self.session.notice = str(error)

        self._stopping = asyncio.create_task(ask(), name="teleop stop")
