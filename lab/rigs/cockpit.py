"""A cockpit in virtual time: control, link and simulated boards, and everything on the wire and in the FlightCtrl kept.

The daemon is wired as in earnest; only Zenoh and the wall clock are left out, so a thousand
flights are exact, seeded and faster than real time.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, cast

from lab.rigs.boardport import ADAPTER_TIME, Socket
from lab.rigs.grounded import GroundedAircraft
from mkdaemon.config.link import LinkConfig
from mkdaemon.config.record import RecordConfig
from mkdaemon.config.root import Config
from mkdaemon.daemon.wiring import Wiring
from mkdaemon.link.link import Link
from mkdaemon.link.session.guarding import LineGuard
from mkdaemon.link.session.traffic import LinkSink, Received, Sent
from mkdaemon.telemetry.command import LeaseRequest
from mkdaemon.telemetry.control import LeaseGrant
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.setpoint import StickSetpoint
from mkdaemon.telemetry.signature import sign
from mksim.config import PilotPlan, SimConfig
from mksim.physics.world import World
from mksim.programs.virtualdaemon import WALL, VirtualDaemon, virtual_clock
from mksim.programs.virtualports import LocalBus
from mksim.simulation import Simulation

GATE_OPEN: Final = 255
"""The pilot's external-control switch."""
PATIENCE: Final = 20.0
"""Longest wait for the boards to be discovered [s; virtual]."""


class Held(NamedTuple):
    """What the FlightCtrl holds from then on.

    Attributes:
        at: when [s].
        is_valid: it asks to control.
        tilt: pitch, roll and yaw, raw.
    """

    at: float
    is_valid: bool
    tilt: tuple[int, int, int]

    @property
    def is_neutral(self) -> bool:
        """Whether it moves nothing: level sticks, or no control at all."""
        return not self.is_valid or self.tilt == (0, 0, 0)


class WatchedSimulation(Simulation):
    """Simulated boards on an aircraft that tilts and stays, keeping what the FlightCtrl holds and applies.

    Attributes:
        held: the external control structure.
        applied: what it added to the pilot's sticks at the last receiver frame.
    """

    def __init__(self, config: SimConfig) -> None:
        bench = GroundedAircraft()
        bench.pilot.gate = GATE_OPEN
        # The boards need of a world what `boards.aircraft.SimulatedAircraft` says, and that one has.
        super().__init__(config, cast("World", bench))
        self.held: list[Held] = []
        self.applied: list[Held] = []
        self._seen: object = None
        self._bench, self._leant_at = bench, 0.0

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run on; see `Simulation.advance`."""
        sent = super().advance(to)
        external, core = self.flight.external, self.flight.core
        if external.held is not self._seen:
            self._seen = held = external.held
            self.held.append(Held(to, external.is_valid, (held.pitch, held.roll, held.yaw)))
        mixed, own = core.mixed, core.receiver
        tilt = (round(mixed.pitch - own.pitch), round(mixed.roll - own.roll), round(mixed.yaw - own.yaw))
        # FLU: right side down is positive, where the board counts the left one.
        self._bench.lean(tilt[0], -tilt[1], to - self._leant_at)
        self._leant_at = to
        if not self.applied or (core.controlled, tilt) != self.applied[-1][1:]:
            self.applied.append(Held(to, core.controlled, tilt))
        return sent

    @property
    def is_controlled(self) -> bool:
        """Whether the FlightCtrl holds a valid external control command."""
        return self.flight.external.is_valid


class LineWatch:
    """What the daemon hears about the line, kept, and handed on to its sink.

    Attributes:
        heard_at: when the latest frame arrived [s].
    """

    def __init__(self, sink: LinkSink) -> None:
        self.dropped, self.health_measured = sink.dropped, sink.health_measured
        self.stream_ended, self.traffic_counted = sink.stream_ended, sink.traffic_counted
        self._sink = sink
        self.tx: list[Sent] = []
        self.heard_at = float("-inf")
        self.states: list[LinkState] = []

    def received(self, frame: Received) -> None:
        """Take a right frame."""
        self._sink.received(frame)
        self.heard_at = frame.at

    def sent(self, frame: Sent) -> None:
        """Take a transmission."""
        self._sink.sent(frame)
        self.tx.append(frame)

    def state_changed(self, state: LinkState) -> None:
        """Take a verdict."""
        self._sink.state_changed(state)
        self.states.append(state)


@dataclass(frozen=True, slots=True)
class Boards:
    """Which boards fly.

    Attributes:
        fc: FlightCtrl release.
        nc: NaviCtrl release in front of it; None where the host is wired to the FlightCtrl.
    """

    fc: str
    nc: str | None = None

    @property
    def name(self) -> str:
        """In words."""
        return f"FC {self.fc}" if self.nc is None else f"FC {self.fc} behind NC {self.nc}"

    def make(self, seed: int, **sim: Any) -> Callable[[], WatchedSimulation]:
        """What powers such an aircraft up."""
        front = {"board": "fc"} if self.nc is None else {"board": "nc", "nc": self.nc}
        settings = {"pilot_plan": PilotPlan.NOTHING, "calibrated": True, "seed": seed, "fc": self.fc} | front | sim
        cfg = SimConfig.model_validate(settings)
        return lambda: WatchedSimulation(cfg)


class Cockpit:
    """Everything of one session.

    Attributes:
        bus: where clients bring what they want, and values are published.
        epoch: of the lease taken last.
        secret: of that lease.
        tasks: of line and control.
    """

    def __init__(self, wiring: Wiring, bus: LocalBus, sink: LineWatch, socket: Socket) -> None:
        self.core, self.link, self.flight, self.run_line = wiring.core, wiring.link, wiring.flight, wiring.run_line
        self.bus, self.sink, self.socket = bus, sink, socket
        self.epoch = 0
        self.secret = ""
        self.tasks: list[asyncio.Task[None]] = []

    @property
    def aircraft(self) -> WatchedSimulation:
        """The boards at the moment."""
        assert isinstance(self.socket.aircraft, WatchedSimulation)
        return self.socket.aircraft

    async def until(self, claim: Callable[[], bool], within: float = PATIENCE, step: float = 0.005) -> float | None:
        """Wait for a claim to hold; returns how long it took [s], None where it did not."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        while not claim():
            if loop.time() - began > within:
                return None
            await asyncio.sleep(step)
        return loop.time() - began

    def forget(self) -> None:
        """Keep nothing of what was seen on the line and in the FlightCtrl so far."""
        for kept in (self.sink.tx, self.aircraft.held, self.aircraft.applied):
            kept.clear()

    @property
    def may_fly(self) -> bool:
        """Whether a lease would be granted and could be flown with."""
        return self.link.is_up and self.link.dialect.extern_control is not None

    async def take(self, holder: str) -> int:
        """Take the lease.

        Raises:
            CommandRejectedError: it was refused.
        """
        lease = await self.flight.lease(LeaseRequest(action="take", holder=holder))
        assert isinstance(lease, LeaseGrant)
        self.epoch, self.secret = lease.epoch, lease.secret
        return self.epoch

    def stream(self, payload: bytes, *, secret: str | None = None) -> None:
        """Put a stick setpoint, signed for the lease taken last or with another secret."""
        proof = sign(self.secret if secret is None else secret, StickSetpoint.suffix, payload)
        self.bus.deliver(StickSetpoint, asyncio.get_running_loop().time(), payload, proof)


@asynccontextmanager
async def cockpit(
    boards: Boards,
    seed: int,
    *,
    link_class: type[Link] = Link,
    sim: dict[str, Any] | None = None,
    socket: Socket | None = None,
    tick: float = ADAPTER_TIME,
    guard: LineGuard | None = None,
    **link: Any,
) -> AsyncIterator[Cockpit]:
    """A running cockpit, boards discovered; not awaited where it begins in the middle of a flight.

    Args:
        link_class: another link, for stories about what happens without a part of it.
        socket: the cable of an earlier cockpit, with the boards at its end; a new one if none is given.
        tick: how often bytes are carried [s].

    Raises:
        TimeoutError: the boards were not discovered.
    """
    is_new = socket is None
    cable = socket or Socket(boards.make(seed, **(sim or {})), seed=seed, tick=tick)
    watches: list[LineWatch] = []

    def make_link(cfg: LinkConfig, sink: LinkSink, **more: Any) -> Link:
        watches.append(LineWatch(sink))
        return link_class(cfg, watches[0], **more)

    cfg = LinkConfig.model_validate({"port": "/dev/virtual"} | link)
    config, bus = Config(link=cfg, record=RecordConfig(enabled=False)), LocalBus()
    # The computer sleeps when its cable says so.
    clock = virtual_clock(wall=WALL + random.Random(f"{seed} wall").random(), slept=lambda: cable.slept)
    daemon = VirtualDaemon(bus, cable.open, config=config, clock=clock, guard=guard, make_link=make_link)
    flown = Cockpit(daemon.wiring, bus, watches[0], cable)
    # What else runs in a daemon touches neither the line nor the sticks.
    flown.tasks = [
        asyncio.create_task(flown.run_line(), name="link"),
        asyncio.create_task(flown.flight.run(), name="control"),
    ]
    try:
        if is_new and await flown.until(lambda: flown.may_fly) is None:
            msg = f"{boards.name}, seed {seed}: not ready to fly: {flown.link.health().state.reason}"
            raise TimeoutError(msg)
        yield flown
    finally:
        for task in reversed(flown.tasks):
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
