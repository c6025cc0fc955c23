"""The link as its users see it: one port, reopened for ever, and the boards at its other end.

Everything happens in the task of `run` and in the callers' own. What may be said is `conversation`, what crosses the
port is `exchange`, what is decided about it is `dialogue`, and who is there `discovery` finds out.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from typing import Protocol

from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import LinkError, LinkLostError
from mkdaemon.link.conversation import Conversation, MotorsRunning
from mkdaemon.link.discovery import discover_boards, discover_flightctrl
from mkdaemon.link.ports.port import Port, open_port
from mkdaemon.link.session.guarding import LineGuard
from mkdaemon.link.session.reopening import AliasMemory, backoff
from mkdaemon.link.session.traffic import LineTap, LinkSink
from mkdaemon.telemetry.link import LinkCondition


class Opener(Protocol):
    """What opens a port; `open_port` in earnest, something else in tests."""

    def __call__(self, url: str, *, baud: int) -> Awaitable[Port]:
        """Open; raises what `open_port` raises."""


class Link(Conversation):
    """A line to a MikroKopter that can be trusted: opened, watched, and opened again."""

    def __init__(
        self,
        cfg: LinkConfig,
        sink: LinkSink,
        *,
        opener: Opener = open_port,
        clock: Clock | None = None,
        motors_running: MotorsRunning = lambda now, within: None,
        guard: LineGuard | None = None,
        tap: LineTap | None = None,
    ) -> None:
        """Prepare; `run` does the work.

        Args:
            cfg: the port, its pace and the streams.
            sink: hears of everything that crosses the line.
            opener: opens the port.
            clock: the machine's if none is given.
            motors_running: who knows whether the motors run; a line is only redirected while it is known that they
                do not.
            guard: hears of the open port and of every stick frame written.
            tap: records the line.

        Raises:
            ConfigError: the configured port or a configured stream cannot exist, or the line cannot carry the rates.
        """
        super().__init__(cfg, sink, clock or Clock(), motors_running, guard, tap)
        self._opener = opener
        self._aliases = AliasMemory()

    async def run(self) -> None:
        """Open, read, write, and open again whenever the port is lost; ends only with a recording.

        Cancelling it ends with a release.

        Raises:
            LinkError: the port could not be opened the first time, and `wait_for_port` is off.
            ConfigError: no such port can ever be opened.
        """
        has_been_open = self._cfg.wait_for_port
        delays = backoff(self._cfg.reopen_min, self._cfg.reopen_max)
        while True:
            try:
                port = await self._open()
            except LinkError as error:
                missing = isinstance(error, LinkLostError)
                self._exchange.port_lost(str(error), LinkCondition.ABSENT if missing else LinkCondition.DOWN)
                if not has_been_open:
                    raise
                await asyncio.sleep(next(delays))
                continue
            has_been_open = True
            try:
                if await self._exchange.serve(port, self._discover):
                    return
            finally:
                self._exchange.port = None
                await port.close()
            delays = backoff(self._cfg.reopen_min, self._cfg.reopen_max)
            await asyncio.sleep(next(delays))

    async def _open(self) -> Port:
        url = self._cfg.port
        try:
            port = await self._opener(url, baud=self._exchange.bauds.current)
        except LinkLostError:
            alias = self._aliases.find(url)
            if alias is None:
                raise
            return await self._opener(alias, baud=self._exchange.bauds.current)
        self._aliases.learn(url)
        return port

    async def _discover(self) -> None:
        """Find out who is there, after the opening and after every silence long enough for a reboot."""
        while True:
            await self._exchange.needs_discovery.wait()
            self._exchange.needs_discovery.clear()
            await discover_boards(self)
            await discover_flightctrl(self, until=self._exchange.needs_discovery)
