"""The composition root: opens things, starts tasks, wires them, and leaves in reverse order.

The order of leaving is a safety argument: control stops first, then the link ends with a release, then the bus closes.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from functools import partial
from importlib.metadata import version
from typing import Final

from mkdaemon.bus.floods import REPORT_PERIOD
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.linger import keep_closing_at_once
from mkdaemon.bus.localsocket import socket_folders, socket_name
from mkdaemon.clock import Clock
from mkdaemon.config.camera import CameraSection
from mkdaemon.config.root import Config
from mkdaemon.daemon.blackbox import BlackBox, open_black_box
from mkdaemon.daemon.cellnote import CellNotes
from mkdaemon.daemon.eyes import open_eyes
from mkdaemon.daemon.flightnote import FlightNotes
from mkdaemon.daemon.guard import GuardProcess, LastWord, take_report
from mkdaemon.daemon.localsocket import LocalSocket
from mkdaemon.daemon.priority import spare_collector
from mkdaemon.daemon.procedures import state_folder
from mkdaemon.daemon.reloading import Reloading
from mkdaemon.daemon.runnable import require_runnable
from mkdaemon.daemon.vitals import status_line
from mkdaemon.daemon.watchdog import Notifier, feed_watchdog
from mkdaemon.daemon.wiring import Wiring
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.link.ports.port import open_port
from mkdaemon.telemetry.position import report_key
from mkdaemon.telemetry.signature import private_key

RECORDING: Final = "replay:"
"""Ports that begin so are recordings."""
OVER_BUS: Final = "zenoh:"
"""Cameras whose images come over the bus have a source that begins so."""
AUDIENCE_WAIT: Final = 3.0
"""A recording waits this long for its first subscriber, so that none of it is lost [s]; as long as
it takes where the configuration says to wait for the port."""
SETTLE: Final = 0.3
"""After the first subscriber has come: time for its other subscriptions, and for the last samples to leave [s]."""


async def run(
    cfg: Config,
    stop: asyncio.Event,
    clock: Clock | None = None,
    last_word: LastWord | None = None,
    reloading: Reloading | None = None,
) -> None:
    """Fly until `stop` is set, or until a recording has ended.

    Args:
        cfg: all of it.
        stop: ends the flight.
        clock: the machine's if none is given.
        last_word: learns what to say to the aircraft where the program has to end at once.
        reloading: reads the configuration again when it is asked to; None for never.

    Raises:
        ConfigError: the configuration cannot work.
        MkError: the bus endpoint is in use, or the port cannot be opened.
    """
    if not cfg.link.port:
        msg = "link.port: no port is configured; set it, or give --port (mkdaemon doctor lists what is plugged in)"
        raise ConfigError(msg)
    require_runnable(cfg)
    notifier, clock = Notifier(), clock or Clock()
    black_box = open_black_box(cfg, clock, is_recording=cfg.link.port.startswith(RECORDING))
    takes_images = any(camera.source.startswith(OVER_BUS) for camera in cfg.cameras)
    opening = Bus.open(
        *(cfg.bus, cfg.vehicle.name, black_box.bus_recorder),
        takes_images=takes_images,
        private_images=private_images(cfg.cameras),
        positions={report_key(source.name): source.secret() for source in cfg.positions},
    )
    async with black_box.run(), opening as bus:
        daemon = Daemon(cfg, bus, clock, black_box, last_word, reloading)
        bus.announce()
        spare_collector()
        try:
            await daemon.serve(stop, notifier)
        except BaseExceptionGroup as group:
            expected, defects = group.split(MkError)
            if expected is None or defects is not None:
                raise
            raise _first(expected) from None
        finally:
            notifier.send("STOPPING=1")


def private_images(cameras: Sequence[CameraSection]) -> dict[str, str]:
    """Keys that only the senders of images know, by the plain ones.

    Raises:
        ConfigError: a secret cannot be read.
    """
    plain = {camera.source.removeprefix(OVER_BUS): camera for camera in cameras if camera.source.startswith(OVER_BUS)}
    secrets = {key: camera.image_secret() for key, camera in plain.items()}
    return {key: private_key(secret, key) for key, secret in secrets.items() if secret is not None}


class Daemon:
    """Everything that runs, wired together."""

    def __init__(
        self,
        cfg: Config,
        bus: Bus,
        clock: Clock,
        black_box: BlackBox | None = None,
        last_word: LastWord | None = None,
        reloading: Reloading | None = None,
    ) -> None:
        """Build and wire; nothing runs yet.

        Raises:
            ConfigError: the port cannot exist, or the line cannot carry the configured rates.
        """
        self._cfg = cfg
        self._bus = bus
        self._clock = clock
        self._reloading = reloading
        self._report = state_folder(cfg.vehicle) / "guard.json"
        needs_guard = cfg.control.guard and not cfg.link.port.startswith(RECORDING)
        self._guard = GuardProcess(self._report, clock=clock.now) if needs_guard else None
        last_word = last_word or LastWord()
        last_word.guard = self._guard
        box = self._black_box = black_box or BlackBox(clock)
        wiring = self._wiring = Wiring(
            cfg,
            bus,
            clock,
            make_eyes=partial(open_eyes, cfg, bus, clock, record=box.image_recorder(cfg.record.images)),
            guard=last_word,
            tap=box.tap,
        )
        self._link, self._flight, self._audit = wiring.link, wiring.flight, wiring.audit
        self._notes = FlightNotes(state_folder(cfg.vehicle), cfg.link.port, clock)
        self._cells = CellNotes(state_folder(cfg.vehicle), cfg.vehicle.battery_cells)
        self._local = LocalSocket(box.recorded(wiring.answer_verb))

    async def serve(self, stop: asyncio.Event, notifier: Notifier) -> None:
        """Run all tasks until `stop`, or until a recording has ended."""
        cfg = self._cfg
        where = ", ".join(cfg.bus.listen + cfg.bus.connect)
        program = f"mkdaemon {version('mkdaemon')}"
        self._audit.log("info", f"{program}: vehicle {cfg.vehicle.name} on {where}; line {cfg.link.port}")
        if self._bus.open_endpoints:
            reachable = ", ".join(self._bus.open_endpoints)
            self._audit.log("warning", f"every program in the network can fly: {reachable} is open (bus.allow_open)")
        for camera in cfg.cameras:
            if camera.source.startswith(OVER_BUS) and camera.secret_file is None:
                text = f"camera {camera.name}: any program can put images to {camera.source}; set secret_file"
                self._audit.log("warning", text)
        for source in cfg.positions:
            if source.secret_file is None:
                text = f"source {source.name}: any program can put poses to {report_key(source.name)}; set secret_file"
                self._audit.log("warning", text)
        report = take_report(self._report)
        if report is not None:
            self._audit.failsafe("guard release", f"an earlier daemon stopped in flight; {report}")
        is_recording = cfg.link.port.startswith(RECORDING)
        memory = None if is_recording else self._notes.read()
        if memory is not None:
            self._audit.log("info", f"an earlier daemon stopped in flight behind a NaviCtrl; FC {memory.firmware}")
            self._link.recall_flight(memory)
        async with self._guarded(), self._listening_locally(), self._wiring.eyes.open(), asyncio.TaskGroup() as line:
            link = line.create_task(self._run_line(), name="link")
            async with asyncio.TaskGroup() as above:
                tasks = [
                    *self._wiring.start(above),
                    above.create_task(self._report_floods(), name="floods"),
                    above.create_task(keep_closing_at_once(), name="connections"),
                    above.create_task(self._black_box.report(self._bus, self._audit), name="black box"),
                    above.create_task(
                        feed_watchdog(notifier, lambda: self._flight.ticks, self._status), name="watchdog"
                    ),
                    (stopped := above.create_task(stop.wait(), name="stop")),
                ]
                if self._reloading is not None:
                    following = self._reloading.follow(cfg, self._reconfigure, self._audit)
                    tasks.append(above.create_task(following, name="reload"))
                if not is_recording:
                    tasks.append(above.create_task(self._notes.follow(self._link, self._audit), name="flight note"))
                    remembering = self._cells.follow(self._wiring.facts, self._wiring.feed, self._audit)
                    tasks.append(above.create_task(remembering, name="battery cells"))
                await asyncio.wait({stopped, link}, return_when=asyncio.FIRST_COMPLETED)
                self._black_box.note_stop()
                for task in tasks:
                    task.cancel()
            link.cancel()

    @asynccontextmanager
    async def _guarded(self) -> AsyncIterator[None]:
        """Keep the guard for as long as anything runs; it ends last, when the line has released the aircraft."""
        guard = self._guard
        if guard is None:
            yield
            return
        guard.acted, guard.changed = self._wiring.guard_acted, self._wiring.guard_changed
        try:
            self._report.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = f"{self._report.parent}: {error.strerror or error}"
            self._audit.log("warning", f"the next daemon will not get the guard's report: {reason}")
        guard.start()
        await guard.wait_for_start()
        async with asyncio.TaskGroup() as tasks:
            watcher = tasks.create_task(guard.watch(), name="guard")
            try:
                yield
            finally:
                watcher.cancel()
                await guard.stop()

    @asynccontextmanager
    async def _listening_locally(self) -> AsyncIterator[None]:
        """Keep the Unix socket; without one the daemon runs all the same.

        Raises:
            ConfigError: its group cannot be used.
        """
        bus = self._cfg.bus
        name = socket_name(self._cfg.vehicle.name, next(iter(bus.listen + bus.connect), ""))
        async with AsyncExitStack() as stack:
            try:
                serving = self._local.serve(socket_folders()[0] / name, bus.local_group)
                await stack.enter_async_context(serving)
            except ConfigError:
                raise
            except MkError as error:
                self._audit.log("warning", f"`mkctl release` needs the bus: {error}")
            yield

    async def _run_line(self) -> None:
        """Run the link; a recording waits for its audience, and gives it time to take the last samples."""
        is_recording = self._cfg.link.port.startswith(RECORDING)
        if is_recording:
            # One that cannot be played is an error now and not after the wait.
            port = await open_port(self._cfg.link.port, baud=self._cfg.link.baud)
            await port.close()
            await self._wait_for_audience()
        await self._wiring.run_line()
        if is_recording:
            await asyncio.sleep(SETTLE)

    async def _wait_for_audience(self) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(None if self._cfg.link.wait_for_port else AUDIENCE_WAIT):
                await self._bus.wait_until_watched()
            await asyncio.sleep(SETTLE)

    def _reconfigure(self, cfg: Config) -> None:
        """Take up the keys that a running daemon can."""
        self._wiring.reconfigure(cfg)
        self._black_box.reconfigure(cfg.record)

    def _status(self) -> str:
        """One line for the service manager."""
        return status_line(self._wiring.health(), self._flight.phase)

    async def _report_floods(self) -> None:
        """Once a second, report dropped samples, and refuse setpoints on keys that no client may write."""
        while True:
            await self._bus.refuse_uninvited()
            shed = ", ".join(f"{count} {what}" for what, count in self._bus.take_shed().items())
            if shed:
                self._audit.log("warning", f"flood: {shed} were shed")
            await asyncio.sleep(REPORT_PERIOD)


def _first(group: BaseExceptionGroup[MkError]) -> MkError:
    """The first error inside nested groups."""
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    assert isinstance(error, MkError)
    return error
