"""A client that takes the lease and streams sticks."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Self

import zenoh

from lab.rigs.waiting import PATIENCE, wait_until
from mkdaemon.client import Vehicle
from mkdaemon.client.lease import SetpointSender
from mkdaemon.client.session import FlightSession
from mkdaemon.errors import MkError
from mkdaemon.telemetry.control import HolderGrant

ENGAGE_WAIT: Final = 4.0
"""A stream that lives is obeyed within this time [s]; the daemon wants one second of it first."""


PERIOD: Final = 0.02
"""Between two setpoints [s]."""


class NotObeyedError(Exception):
    """A flight that was to be disturbed never began: nothing is known of what comes after."""


class Pilot:
    """A client that holds a lease and streams sticks for as long as the context lasts.

    Attributes:
        sticks: what it streams [stick; FLU].
        puts: when it put its setpoints [s; monotonic].
    """

    def __init__(self, client: Vehicle, name: str) -> None:
        self.name = name
        self.sticks = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
        self.epoch = 0
        self.secret = ""
        self.puts: list[float] = []
        self._client = client
        # Rogue on purpose: it listens to nobody, and streams on under a lease that it has lost.
        self.session = FlightSession(silence=math.inf)
        self._sender: SetpointSender | None = None
        self._task: asyncio.Task[None] | None = None

    async def take(self, *, force: bool = False) -> bool:
        """Ask for the lease; returns whether it was granted."""
        fields = {"action": "take", "holder": self.name, "force": force}
        answer = await self._client.command("do", "lease", fields)
        if answer.is_accepted:
            self.accept(answer.as_a(HolderGrant))
        return answer.is_accepted

    def accept(self, grant: HolderGrant) -> None:
        """Stream under a lease, which may be a forged one."""
        self.epoch, self.secret = grant.epoch, grant.secret
        self.session.take()
        self.session.granted(grant, asyncio.get_running_loop().time())
        self._sender = SetpointSender(self._client, grant)

    async def engage(self, is_controlled: Callable[[], bool]) -> None:
        """Take the lease and wait until the aircraft obeys.

        A busy machine may cost a client its lease before it flies; then it is taken once more, and stderr says so.

        Raises:
            NotObeyedError: it did not obey within `PATIENCE`.
        """
        loop = asyncio.get_running_loop()
        end, force = loop.time() + PATIENCE, False
        while True:
            try:
                await self._engage_once(is_controlled, force=force)
            except (TimeoutError, MkError) as why:
                if loop.time() > end:
                    raise NotObeyedError(f"{self.name}: not obeyed within {PATIENCE:g} s") from why
                print(f"{self.name}: not obeyed within {ENGAGE_WAIT:g} s; takes the lease once more", file=sys.stderr)
                force = True
            else:
                return

    async def _engage_once(self, is_controlled: Callable[[], bool], *, force: bool = False) -> None:
        async with asyncio.timeout(ENGAGE_WAIT):
            while not await self.take(force=force):  # noqa: ASYNC110 - the answer comes from another process
                await asyncio.sleep(0.1)
        await wait_until(is_controlled, ENGAGE_WAIT)

    async def __aenter__(self) -> Self:
        self._task = asyncio.create_task(self._stream(), name=f"pilot {self.name}")
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    async def stop(self) -> None:
        """Stream no more; the lease stays."""
        assert self._task is not None
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def _stream(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        with suppress(zenoh.ZError):  # the daemon may be killed while it streams: that is what some stories are about
            while True:
                self.puts.append(time.monotonic())
                if self._sender is not None:
                    setpoint = self.session.stream("stick", self.sticks, loop.time())
                    assert setpoint is not None
                    self._sender.send(setpoint)
                due = max(due + PERIOD, loop.time())
                await asyncio.sleep(due - loop.time())
