"""A daemon in virtual time: everything of `mkdaemon run` but Zenoh, the serial port and the cameras' images.

Demonstration, tests, campaigns and the proving ground have their daemons from here. What differs are the ends: the bus,
the line, the cameras, the recorder and the guard.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from mkdaemon.clock import Clock
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.config.control import ControlConfig
from mkdaemon.config.link import LinkConfig
from mkdaemon.config.record import RecordConfig
from mkdaemon.config.root import Config
from mkdaemon.daemon.deck import MakeEyes, no_eyes
from mkdaemon.daemon.procedures import Journal
from mkdaemon.daemon.wiring import BusStation, Wiring
from mkdaemon.link.link import Link, Opener
from mkdaemon.link.session.guarding import LineGuard
from mkdaemon.record.tap import Tap
from mkdaemon.virtualtime import AtOnce

WALL: Final = 1.7e9
"""Unix time at which virtual time begins [s]."""


def virtual_clock(*, wall: float = WALL, slept: Callable[[], float] = lambda: 0.0) -> Clock:
    """The clock of a computer whose time is that of the running loop.

    Args:
        wall: Unix time at which the loop's time is zero [s].
        slept: total time the computer was suspended [s].
    """
    loop = asyncio.get_running_loop()
    return Clock(
        monotonic=loop.time, wall=lambda: wall + loop.time() + slept(), synchronised=lambda: True, suspended=slept
    )


def virtual_config(**autopilot: Any) -> Config:
    """One port and no recording, with some values of `control.autopilot`."""
    control = ControlConfig(autopilot=AutopilotConfig(**autopilot))
    return Config(link=LinkConfig(port="/dev/simulated"), record=RecordConfig(enabled=False), control=control)


class VirtualDaemon:
    """A daemon of which nothing runs before `start`; needs a running loop.

    Attributes:
        clock: stamps and measures.
        journal: of unfinished procedures.
        wiring: its parts.
        tasks: what runs, the line first.
    """

    def __init__(
        self,
        bus: BusStation,
        line: Opener,
        *,
        config: Config | None = None,
        clock: Clock | None = None,
        eyes: MakeEyes = no_eyes,
        recorder: Tap | None = None,
        guard: LineGuard | None = None,
        journal: Path = Path(os.devnull),
        make_link: Callable[..., Link] = Link,
    ) -> None:
        """Put it together.

        Args:
            bus: where values go, and requests come from.
            line: opens the port to the boards.
            config: all of it; one port and no recording if none is given.
            clock: that of the loop if none is given.
            eyes: makes the cameras.
            recorder: of the line and of the flight core's events.
            guard: hears of the open port and of each stick frame.
            journal: file of unfinished procedures.
            make_link: makes the link.
        """
        self.clock = clock or virtual_clock()
        self.journal = Journal(journal, AtOnce())
        self.wiring = Wiring(
            config or virtual_config(),
            bus,
            self.clock,
            make_eyes=eyes,
            guard=guard,
            opener=line,
            tap=recorder,
            journal=self.journal,
            make_link=make_link,
        )
        self.tasks: list[asyncio.Task[Any]] = []

    def start(self) -> None:
        """Start everything."""
        loop = asyncio.get_running_loop()
        self.tasks = [loop.create_task(self.wiring.run_line(), name="link"), *self.wiring.start(loop)]

    async def stop(self) -> None:
        """End everything in order: what uses the line before the line."""
        for task in reversed(self.tasks):
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        self.tasks = []
