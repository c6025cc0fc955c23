"""Everything between the port and the bus, wired together: what is the same on an aircraft and in a replay.

What differs comes from outside: the bus, the clock, what opens the port, the guard, the cameras. `Daemon` in
`program` runs it on the machine's own; `replay` on those of a recording.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Protocol

from mkdaemon.bus.commandserver import Handler
from mkdaemon.bus.gateway import Watcher
from mkdaemon.bus.intake import Taker, Verifier
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.events import Event
from mkdaemon.control.regulator.margins import require_safe_loop
from mkdaemon.daemon.audit import Outlet
from mkdaemon.daemon.blackbox import recording_folder
from mkdaemon.daemon.deck import Deck, MakeEyes
from mkdaemon.daemon.flight import FlightControl
from mkdaemon.daemon.pathdelay import PathProbe
from mkdaemon.daemon.procedures import Interlock, Journal, ProcedureRunner, state_folder
from mkdaemon.daemon.requests import BoardRequests
from mkdaemon.daemon.verbs import Verbs
from mkdaemon.daemon.vitals import vehicle_health
from mkdaemon.link.discovery import discover
from mkdaemon.link.labels import LabelCache
from mkdaemon.link.link import Link, Opener
from mkdaemon.link.ports.port import open_port
from mkdaemon.link.session.guarding import LineGuard
from mkdaemon.telemetry.base import build_models
from mkdaemon.telemetry.control import ControlFence
from mkdaemon.telemetry.setpoint import SETPOINTS
from mkdaemon.telemetry.vehicle import VehicleHealth

if TYPE_CHECKING:
    from mkdaemon.record.tap import Tap

HEALTH_PERIOD: Final = 1.0
"""The vehicle's signs of life are published at least this often [s]."""
HEALTH_LOOK: Final = 0.1
"""Time between two looks at them [s]."""
FENCE_PERIOD: Final = 10.0
"""Time between two publications of the fence, so that every part of a recording has it [s]."""
CLOCK_LOOK: Final = 0.5
"""Time between two looks for a step of the system clock [s]."""


class BusStation(Outlet, Protocol):
    """The bus as the daemon stands on it: `mkdaemon.bus.gateway.Bus` in earnest."""

    open_endpoints: tuple[str, ...]
    setpoint_root: str

    def serve(self, root: str, handler: Handler) -> None:
        """Answer every command below a root; see `Bus.serve`."""

    def receive(self, suffix: str, take: Taker, verify: Verifier) -> None:
        """Hand every setpoint of a key to `take`; see `Bus.receive`."""

    def receive_reports(self, suffix: str, take: Taker, verify: Verifier, secret: str | None) -> None:
        """Hand the reports of a source of poses to `take`; see `Bus.receive_reports`."""

    def watch_client(self, name: str | None, watcher: Watcher) -> None:
        """Hear when a client comes or goes; see `Bus.watch_client`."""


class Wiring:
    """The parts, wired; nothing runs yet.

    Attributes:
        facts: what is known about the vehicle.
        audit: publishes events.
        eyes: the cameras.
        link: the line.
        core: decides what is flown; `flight` runs it.
        flight: control.
        interlock: between procedures, requests and flights.
        requests: to the boards.
        procedures: settings, waypoints.
        answer_verb: answers `do/<verb>`.
    """

    def __init__(
        self,
        cfg: Config,
        bus: BusStation,
        clock: Clock,
        *,
        make_eyes: MakeEyes,
        guard: LineGuard | None = None,
        opener: Opener = open_port,
        tap: Tap | None = None,
        journal: Journal | None = None,
        make_link: Callable[..., Link] = Link,
    ) -> None:
        """Build and wire.

        Args:
            cfg: all of it.
            bus: where values go, and requests come from.
            clock: stamps and measures.
            make_eyes: makes the cameras.
            guard: hears of the open port and of every stick frame written.
            opener: opens the port.
            tap: records the line, and the flight core's events.
            journal: of procedures; the vehicle's own if none is given.
            make_link: makes the line, from what `Link` is made of.

        Raises:
            ConfigError: the port cannot exist, the line cannot carry the configured rates, a camera is wrong, or a
                value makes the control loop unsafe.
        """
        build_models()
        self._cfg, self._bus, self._clock = cfg, bus, clock
        if cfg.cameras or cfg.positions:
            require_safe_loop(cfg.control)
        # Milliseconds since 1970: above every epoch of an earlier run, whatever a client still streams.
        first_epoch = int(clock.stamp().wall * 1000)
        eyes: dict[str, Any] = {"make_eyes": make_eyes, "positions": cfg.positions}
        deck = self._deck = Deck(cfg.control, bus, clock, first_epoch=first_epoch, tap=tap, **eyes)
        self.core, self.facts = deck.core, (facts := deck.core.vehicle)
        audit, self.audit, self.eyes = deck.audit, deck.audit, deck.eyes
        link = self.link = make_link(
            cfg.link, deck.sink, opener=opener, clock=clock, motors_running=facts.motors_running, guard=guard, tap=tap
        )
        flight = self.flight = FlightControl(
            deck, link, clock=clock, records=recording_folder(cfg), watch_client=bus.watch_client
        )
        interlock = self.interlock = Interlock(lambda: deck.core.situation(clock.now()))
        requests = self.requests = BoardRequests(cfg.commands, link, facts, deck.feed, audit, clock, interlock)
        self.procedures = ProcedureRunner(
            link,
            facts,
            *(deck.feed, bus, audit, requests, interlock),
            journal or Journal(state_folder(cfg.vehicle)),
            LabelCache(cfg.link.label_cache),
            clock,
        )
        probe, verbs, root = PathProbe(clock.now), self.procedures.verbs, bus.setpoint_root
        self.answer_verb = Verbs(flight, link, audit, interlock, verbs, probe, root).answer
        self.guard_acted, self.guard_changed = flight.guard_acted, flight.guard_changed
        self._serve()

    def reconfigure(self, cfg: Config) -> None:
        """Take up the keys that a running daemon can; see `mkdaemon.config.reload`."""
        self._cfg = cfg
        self.requests.reconfigure(cfg.commands)

    def feed(self, event: Event) -> None:
        """Let the flight core know of something that happens now."""
        self._deck.feed(event, self._clock.now())

    def _serve(self) -> None:
        """Be there for the bus: requests and setpoints."""
        bus, deck = self._bus, self._deck
        bus.serve("cmd", self.requests.answer)
        bus.serve("do", self.answer_verb)
        for kind in SETPOINTS:
            bus.receive(kind.suffix, partial(deck.setpoint_arrived, kind), partial(deck.signed_for, kind))
        deck.positions.receive_from(bus)

    async def run_line(self) -> None:
        """Keep the line; see `Link.run`."""
        await self.link.run(discover)

    def start(self, tasks: asyncio.TaskGroup | asyncio.AbstractEventLoop) -> list[asyncio.Task[None]]:
        """Start what stands above the line: control, procedures, and what is published by the clock."""
        return [
            tasks.create_task(self.flight.run(), name="control"),
            tasks.create_task(self.procedures.run(), name="procedures"),
            tasks.create_task(self._publish_health(), name="health"),
            tasks.create_task(self._publish_fence(), name="fence"),
            tasks.create_task(self._watch_system_clock(), name="clock"),
            *([tasks.create_task(self._deck.positions.run(), name="positions")] if self._cfg.positions else []),
        ]

    def health(self) -> VehicleHealth:
        """The vehicle's signs of life, now."""
        note, reachable = self._cfg.vehicle.note, self._bus.open_endpoints
        return vehicle_health(self.facts, self.link, self._clock.stamp(), note=note, open_endpoints=reachable)

    async def _publish_health(self) -> None:
        """Publish whether the vehicle is alive, once a second and at once when it changes."""
        published, published_at = None, float("-inf")
        while True:
            health = self.health()
            content = health.model_dump(exclude={"stamp"})
            if content != published or health.stamp.monotonic - published_at >= HEALTH_PERIOD:
                published, published_at = content, health.stamp.monotonic
                self._bus.publish("health", health)
            await asyncio.sleep(HEALTH_LOOK)

    async def _publish_fence(self) -> None:
        """Publish where autonomous flight ends, now and then."""
        limits = self._cfg.control.autopilot
        shown = {"radius": limits.fence_radius, "height": limits.fence_height, "floor": limits.fence_floor}
        while True:
            self._bus.publish("control/fence", ControlFence(stamp=self._clock.stamp(), **shown))
            await asyncio.sleep(FENCE_PERIOD)

    async def _watch_system_clock(self) -> None:
        """Publish every step of the system clock."""
        while True:
            for step in self._clock.take_steps():
                self.audit.clock_stepped(step)
            await asyncio.sleep(CLOCK_LOOK)
