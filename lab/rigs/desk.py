"""An operator's desk in virtual time: a simulated aircraft over its target, its whole daemon, and `mkctl` at its bus.

Every command is the product's own, from the words of its command line to its last line of text. Time passes while one
runs, and while somebody waits; a flight of a minute takes seconds. Left out are Zenoh, the guard, and the search for
tags in images: the camera knows where the target is.
"""

from __future__ import annotations

import asyncio
import contextvars
import io
import logging
import os
import runpy
import shlex
import socket
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import AsyncExitStack, ExitStack, chdir, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar, cast
from unittest.mock import patch

import numpy as np
import structlog
from cyclopts import App

from lab.control.corerig import pose_of
from lab.places import ROOT
from lab.rigs.boardport import Socket
from lab.rigs.innerbus import InnerBus, InnerSession
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.bus.names import key
from mkdaemon.cli.mkctl import app as mkctl
from mkdaemon.cli.mkctl.commands import GROUPS
from mkdaemon.cli.mkdaemon import app as mkdaemon
from mkdaemon.cli.program import report_mistakes, run
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.events import Feed
from mkdaemon.control.linear import Array
from mkdaemon.daemon.blackbox import open_black_box
from mkdaemon.daemon.eyes import Eyes, PoseSink
from mkdaemon.record.folder import RecordingFolder
from mkdaemon.telemetry.record import RecorderState
from mkdaemon.telemetry.vision import EyeState, VisionStats
from mkdaemon.virtualtime import VirtualLoop, end_loop
from mksim.config import PilotPlan, SimConfig
from mksim.programs.sim_bus import SimBus
from mksim.programs.virtualdaemon import VirtualDaemon, virtual_clock
from mksim.simulation import Simulation

if TYPE_CHECKING:
    import zenoh

    from mkdaemon.bus.gateway import Bus
VEHICLE: Final = "mk1"
FOLDER: Final = "~/.local/state/mkdaemon/mk1"
"""What stands for the daemon's folder in what is typed and printed."""
HOLDER: Final = "alice-ground-4711"
"""What a client names itself: user, machine, process."""
ENDPOINT: Final = "tcp/127.0.0.1:7447"
"""What stands for its endpoint."""
FREE_PORT: Final = "127.0.0.1:7448"
"""What stands for a port that nobody uses."""
TICK: Final = 1.6e-2
"""How often bytes are carried [s]."""
RATES: Final = {"osd": 250, "attitude": 50, "debug": 500}
"""Intervals of the streams [ms]: fewer than the line carries take less time to compute."""
IMAGES: Final = 10.0
"""Images a second [Hz]."""
LATENCY: Final = 0.08
"""From the exposure to the pose [s]."""
TRUTHS: Final = 10.0
"""How often the true state is published [Hz]."""
NOTICED: Final = 3.0
"""Longest wait for the recorder to notice what happened to the disk [s]."""
READY: Final = 30.0
"""Longest wait for the boards to be known [s]."""
SETTLED: Final = 5.0
"""From then until somebody types the first command [s]."""
WAITS: Final = 600.0
"""The pilot waits so long, unless he is asked [s]."""
CAMERA: Final = ROOT / "configs" / "cameras" / "sim.toml"
TARGET: Final = ROOT / "configs" / "targets" / "nested.toml"
COVARIANCE: Final = 1e-4 * np.eye(6)
"""Of a pose: 1 cm and 0.01 rad."""
_Result = TypeVar("_Result")


class DeskLoop(VirtualLoop):
    """Virtual time in which threads take none."""

    def run_in_executor(  # type: ignore[override]
        self, executor: Executor | None, func: Callable[..., _Result], *args: Any
    ) -> asyncio.Future[_Result]:
        """Do it at once."""
        del executor
        future: asyncio.Future[_Result] = self.create_future()
        try:
            future.set_result(func(*args))
        except Exception as error:  # noqa: BLE001  # it belongs to who waits
            future.set_exception(error)
        return future


LOWEST_VIEW: Final = 0.12
"""Below it the camera, 5 cm ahead of the middle, has only half of the inner tag in its image [m]."""


class SeeingEyes(Eyes):
    """A camera that knows where the target is, while it is in its view and nothing covers it."""

    def __init__(self, feed: Feed, bus: InnerBus, clock: Clock, simulation: Callable[[], Simulation]) -> None:
        super().__init__(None)
        self._sink, self._clock, self._simulation = PoseSink(feed, bus, clock), clock, simulation
        self._seen = self._posed = 0

    async def run(self) -> None:
        """Look for ever."""
        loop = asyncio.get_running_loop()
        for number in range(sys.maxsize):
            faults = self._simulation().world.faults
            is_open = not faults.is_active("camera_off")
            if is_open:
                self._seen += 1
                truth = self._simulation().world.truth
                is_hidden = faults.is_active("tag_covered") or faults.is_active("light_off")
                if not is_hidden and truth.position_enu[2] >= LOWEST_VIEW:
                    self._posed += 1
                    loop.call_later(LATENCY, self._see, self._clock.now(), truth.position_enu, truth.enu_from_flu)
            if number % int(IMAGES) == 0:
                self._sink.publish("vision/down/stats", self._stats(is_open=is_open))
                self._seen = self._posed = 0
            await asyncio.sleep(1.0 / IMAGES)

    def _see(self, at: float, position: Array, target_from_flu: Array) -> None:
        """Hand a pose on."""
        seen = TargetView(at, -target_from_flu.T @ position, target_from_flu, COVARIANCE, "down")
        self._sink.publish("vision/down/pose", pose_of(seen).model_copy(update={"stamp": self._clock.stamp(at)}))

    def _stats(self, *, is_open: bool) -> VisionStats:
        return VisionStats(
            stamp=self._clock.stamp(),
            camera="down",
            state=EyeState.OK if is_open else EyeState.SILENT,
            reason="" if is_open else "no image for 1 s: check its cable",
            alarms={},
            source="/dev/video0",
            width=640,
            height=480,
            fps=IMAGES if is_open else 0.0,
            processed=self._seen,
            dropped=0,
            lost=0,
            damaged=0,
            reopened=0,
            faults=0,
            restarts=0,
            posed=self._posed / self._seen if self._seen else 0.0,
            refused={},
            detect_p50_ms=10.0,
            detect_p99_ms=15.0,
            latency_p50_ms=80.0,
            latency_p99_ms=90.0,
            settings_refused=(),
        )


class Screen(io.TextIOBase):
    """Standard output and error of whichever command runs: each has a page of its own."""

    def __init__(self) -> None:
        self.page: contextvars.ContextVar[io.StringIO] = contextvars.ContextVar("page")
        self._nowhere = os.open(os.devnull, os.O_WRONLY)

    def write(self, text: str) -> int:
        """Print."""
        return self.page.get().write(text)

    def fileno(self) -> int:
        """Where those write who want a file: nowhere."""
        return self._nowhere

    @contextmanager
    def fresh(self) -> Iterator[io.StringIO]:
        """A new page."""
        page = io.StringIO()
        token = self.page.set(page)
        try:
            yield page
        finally:
            self.page.reset(token)


class Behind(NamedTuple):
    """A command that runs in the background."""

    program: App
    words: list[str]
    page: io.StringIO
    task: asyncio.Task[Any]


class Desk:
    """Everything on it; made by `desk`.

    Attributes:
        folder: of its recordings and its state.
        is_full: the disk has no room left.
    """

    def __init__(self, config: Config, sim: SimConfig, folder: Path, loop: DeskLoop, screen: Screen) -> None:
        self.config, self.folder, self.loop = config, folder, loop
        self.is_full = False
        self.endpoint = ENDPOINT
        self._sim, self._screen = sim, screen
        self._happenings = {
            "# Ctrl-C ends the daemon": self._end_daemon,
            "# another program fills the disk": self._fill_disk,
            "# the disk has room again": self._empty_disk,
        }
        self._behind: Behind | None = None
        self._jobs: list[asyncio.Task[None]] = []
        self._stack = AsyncExitStack()
        self.socket: Socket
        self.bus: InnerBus

    @property
    def simulation(self) -> Simulation:
        """The aircraft."""
        return self.socket.aircraft

    async def start(self) -> None:
        """Switch everything on; returns when the boards are known."""
        loop = self.loop
        clock = virtual_clock()
        box = self._box = open_black_box(self.config, clock, is_recording=False)
        await self._stack.enter_async_context(box.run())
        bus = self.bus = InnerBus(VEHICLE, box.bus_recorder)
        self.socket = Socket(lambda: Simulation(self._sim), seed=self._sim.seed, tick=TICK)

        def see(feed: Feed) -> Eyes:
            return SeeingEyes(feed, bus, clock, lambda: self.simulation)

        daemon = VirtualDaemon(
            bus,
            self.socket.open,
            config=self.config,
            clock=clock,
            eyes=see,
            recorder=box.tap,
            journal=self.folder / "journal",
        )
        wiring = self.wiring = daemon.wiring
        wiring.guard_changed(True)
        assert isinstance(wiring.eyes, SeeingEyes)
        self._stack.enter_context(bus.show_token(key(VEHICLE, "alive")))
        session = self._stack.enter_context(closing(InnerSession(bus)))
        sim_bus = SimBus(cast("zenoh.Session", session), self.simulation, VEHICLE, "/dev/pts/7")
        daemon.start()
        self._jobs = [
            *daemon.tasks,
            loop.create_task(wiring.eyes.run(), name="eyes"),
            loop.create_task(box.report(cast("Bus", bus), wiring.audit), name="black box"),
            loop.create_task(sim_bus.publish(TRUTHS), name="simulator on the bus"),
        ]
        async with asyncio.timeout(READY):
            while not (wiring.link.is_up and wiring.link.dialect.extern_control is not None):  # noqa: ASYNC110
                await asyncio.sleep(0.05)
        await asyncio.sleep(SETTLED)

    async def stop(self) -> None:
        """Switch everything off in order."""
        if not self._jobs:
            return
        self._box.note_stop()
        for job in reversed(self._jobs):
            job.cancel()
            await asyncio.gather(job, return_exceptions=True)
        self._jobs = []
        await self._stack.aclose()

    def type(self, line: str) -> str:
        """Carry out a line as a shell does; what it prints.

        Args:
            line: a command of `mkctl` or `mkdaemon`, with `&` behind it if it is to run in the background; `wait` for
                that one; `python FILE`; `sleep SECONDS`; `cd FOLDER`; or, behind `#`, something that happens.
        """
        if line in self._happenings:
            self._happenings[line]()
            return ""
        name, *words = shlex.split(self._here(line), comments=True)
        with self._screen.fresh() as page:
            match name:
                case "sleep":
                    self.loop.run_until_complete(asyncio.sleep(float(words[0])))
                case "cd":
                    os.chdir(words[0])
                case "wait":
                    return self._there(self._wait())
                case "mkctl" if words[-1] == "&":
                    self._begin(mkctl.app, mkctl.move_behind_command(words[:-1], GROUPS), page)
                case "mkctl":
                    run(mkctl.app, mkctl.move_behind_command(words, GROUPS))
                case "mkdaemon":
                    run(mkdaemon.app, words)
                case "python":
                    self._run_program(words)
                case _:
                    raise ValueError(f"{name}: not on this desk")
        return self._there(page.getvalue())

    def _run_program(self, words: list[str]) -> None:
        """Run a program that stands on the client library; if it ends with a message, print that as Python does."""
        with patch("sys.argv", words):
            try:
                runpy.run_path(words[0], run_name="__main__")
            except SystemExit as end:
                if end.code is not None:
                    print(end.code)

    def _here(self, line: str) -> str:
        """A line as it must be typed on this machine."""
        return line.replace(FOLDER, str(self.folder)).replace(ENDPOINT, self.endpoint).replace(FREE_PORT, "127.0.0.1:0")

    def _there(self, text: str) -> str:
        """What was printed, as on the machine of the page."""
        return text.replace(str(self.folder), FOLDER).replace(self.endpoint, ENDPOINT)

    def _end_daemon(self) -> None:
        self.loop.run_until_complete(self.stop())

    def _fill_disk(self, *, is_full: bool = True) -> None:
        """Change what the recorder, on its own thread and in real time, finds; returns when it has found it."""
        self.is_full = is_full
        ends = time.monotonic() + NOTICED
        while (self._box.status().state is RecorderState.RECORDING) is is_full and time.monotonic() < ends:
            time.sleep(0.01)
            self.loop.run_until_complete(asyncio.sleep(0.05))

    def _empty_disk(self) -> None:
        self._fill_disk(is_full=False)

    def _begin(self, program: App, words: list[str], page: io.StringIO) -> None:
        command, bound, _ = program.parse_args(words, exit_on_error=False, print_error=False)
        task = self.loop.create_task(command(*bound.args, **bound.kwargs))
        self._behind = Behind(program, words, page, task)
        self.loop.run_until_complete(asyncio.sleep(0.0))

    def _wait(self) -> str:
        """Wait for the command in the background; what it printed."""
        behind, self._behind = self._behind, None
        assert behind is not None
        token = self._screen.page.set(behind.page)
        report_mistakes(behind.program, behind.words, lambda: self.loop.run_until_complete(behind.task))
        self._screen.page.reset(token)
        return behind.page.getvalue()

    def free_space(self, _: object) -> int:
        """Of the disk of the recordings [bytes]."""
        return 0 if self.is_full else 50_000_000_000


@contextmanager
def desk(folder: Path, **sim: Any) -> Iterator[Desk]:
    """A desk for as long as the context lasts."""
    config = Config.model_validate(
        {
            "vehicle": {"name": VEHICLE, "note": "simulated aircraft", "state_folder": folder},
            "link": {"port": "/dev/pts/7", "rates": RATES},
            "cameras": ({"name": "down", "source": "/dev/video0", "calibration": CAMERA, "targets": (TARGET,)},),
        }
    )
    settings = {"seed": 1, "calibrated": True, "pilot_plan": PilotPlan.START, "pilot_wait": WAITS} | sim
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    loop, screen = DeskLoop(), Screen()
    made = Desk(config, SimConfig.model_validate(settings), folder, loop, screen)

    async def open_session(*_: object, **__: object) -> InnerSession:
        return InnerSession(made.bus)

    async def close_session(session: InnerSession) -> None:
        session.close()

    with ExitStack() as stack:
        stack.enter_context(chdir(Path.cwd()))  # whatever `cd` is typed on it
        made.endpoint = stack.enter_context(reserved_endpoint())
        host, _, port = made.endpoint.removeprefix("tcp/").partition(":")
        occupied = stack.enter_context(socket.create_server((host, int(port)), reuse_port=True))
        del occupied
        for place, instead in (
            ("mkdaemon.client.connection.open_session", open_session),
            ("mkdaemon.client.connection.close_session", close_session),
            ("mkdaemon.record.recorder.LOOK", 0.02),
            ("mkdaemon.cli.mkdaemon.run.configure", lambda level: None),  # logs would take the screen
            ("mkdaemon.daemon.flight.free_disk", lambda folder: float(made.free_space(folder))),
            ("mkdaemon.client.asking.client_name", lambda: HOLDER),
            ("mkdaemon.client.lease.client_name", lambda: HOLDER),
            ("zenoh.SourceInfo", lambda *_: None),  # who asks is one and the same
            ("asyncio.run", loop.run_until_complete),
            ("sys.stdout", screen),
            ("sys.stderr", screen),
        ):
            stack.enter_context(patch(place, instead))
        stack.enter_context(patch.dict(RecordingFolder.__init__.__kwdefaults__, {"free": made.free_space}))
        stack.enter_context(patch.dict(os.environ, {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}))
        with screen.fresh():
            loop.run_until_complete(made.start())
        try:
            yield made
        finally:
            with screen.fresh():
                loop.run_until_complete(made.stop())
                end_loop(loop)
            os.close(screen.fileno())
