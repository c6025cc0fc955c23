"""A whole daemon in virtual time, one client of it, and what the FlightCtrl at the end of its cable holds."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from lab.hil.chip import Held
from mkdaemon.link.session.guarding import LineGuard
from mksim.programs.virtualdaemon import VirtualDaemon
from mksim.programs.virtualports import Aircraft, Cable, LocalBus

LOOK: Final = 0.004
"""Between two looks at what is waited for [s]."""


class CutCable:
    """The aircraft behind a cable whose daemon may fall silent."""

    def __init__(self, aircraft: Aircraft) -> None:
        self.aircraft, self.now = aircraft, aircraft.now
        self.is_cut = self.is_deaf = False

    def write(self, data: bytes, at: float) -> None:
        """Bytes of the daemon."""
        if not self.is_cut:
            self.aircraft.write(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run on."""
        said, self.now = self.aircraft.advance(to), to
        return [] if self.is_deaf else said


class Client:
    """A client and its daemon, which is wired as on an aircraft: link, requests, flight core.

    Attributes:
        loop: that runs.
        cable: to the aircraft.
        bus: that the daemon and the client are at.
        daemon: of which nothing runs yet.
        wiring: its parts.
        held: what the FlightCtrl held from a time on [s].
    """

    def __init__(self, aircraft: Aircraft, held: Callable[[], Held], guard: LineGuard | None = None) -> None:
        """Wire it up; needs a running loop. `held` returns what the FlightCtrl holds now."""
        self.loop, self.cable, self.bus = asyncio.get_running_loop(), CutCable(aircraft), LocalBus()
        self.held: list[tuple[float, Held]] = []
        self._held = held
        self.daemon = VirtualDaemon(self.bus, Cable(self.cable, self._moved).open, guard=guard)
        self.wiring = self.daemon.wiring

    def _moved(self, now: float) -> None:
        held = self._held()
        if not self.held or self.held[-1][1] != held:
            self.held.append((now, held))

    @property
    def is_line_known(self) -> bool:
        """Whether the link is up, and the boards behind it are known."""
        return self.wiring.link.is_up and self.wiring.link.dialect.extern_control is not None

    async def until(self, claim: Callable[[], bool], within: float) -> float | None:
        """Wait for a claim; how long that took [s], None where it never held."""
        began = self.loop.time()
        while not claim():
            if self.loop.time() - began > within:
                return None
            await asyncio.sleep(LOOK)
        return self.loop.time() - began
