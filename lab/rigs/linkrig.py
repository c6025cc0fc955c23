"""A link in virtual time, with simulated boards at the other end and everything it reports kept."""

from __future__ import annotations

import asyncio
import functools
import inspect
from collections import Counter
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, cast

from lab.rigs.boardport import ADAPTER_TIME, Socket
from lab.rigs.grounded import GroundedAircraft
from lab.rigs.waiting import in_virtual_time, running, wait_until
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.link.session.guarding import LineGuard
from mkdaemon.link.session.traffic import LinkSink, Lost, Received, Sent
from mkdaemon.protocol.boards import board_at
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.telemetry.link import LinkHealth, LinkState, LinkTraffic
from mkdaemon.translate.state import motors_running
from mksim.config import PilotPlan, SimConfig
from mksim.physics.world import World
from mksim.simulation import Simulation

AsyncTest = Callable[..., Coroutine[Any, Any, None]]


virtually = in_virtual_time
"""Runs a test in virtual time (pytest sees a plain function with the same arguments)."""


class Log:
    """A sink that keeps everything."""

    def __init__(self) -> None:
        self.rx: list[Received] = []
        self.tx: list[Sent] = []
        self.lost: list[Lost] = []
        self.ended: list[str] = []
        self.states: list[LinkState] = []
        self.healths: list[LinkHealth] = []
        self.traffics: list[LinkTraffic] = []
        self.dropped, self.stream_ended, self.state_changed = self.lost.append, self.ended.append, self.states.append
        self.health_measured, self.traffic_counted = self.healths.append, self.traffics.append

    def received(self, frame: Received) -> None:
        """Keep a right frame."""
        self.rx.append(frame)

    def sent(self, frame: Sent) -> None:
        """Keep a transmission."""
        self.tx.append(frame)

    def kinds(self, since: float = 0.0) -> Counter[str]:
        """Count received frames by letter, from a time on [s]."""
        return Counter(frame.frame.id for frame in self.rx if frame.at >= since)


class MotorWatch:
    """A sink that passes everything on and remembers what telemetry says about the motors: a link wants to know.

    Attributes:
        facts: what is known; `facts.motors_running` is what the link asks.
    """

    def __init__(self, sink: LinkSink) -> None:
        self.facts = VehicleMemory()
        self.sent, self.dropped, self.health_measured = sink.sent, sink.dropped, sink.health_measured
        self.stream_ended, self.traffic_counted = sink.stream_ended, sink.traffic_counted
        self._sink = sink

    def received(self, frame: Received) -> None:
        """Take a right frame."""
        board = board_at(frame.frame.address)
        if board is not None and not isinstance(frame.message, Unknown):
            running = motors_running(board.word, frame.message)
            if running is not None:
                self.facts.motors_reported(running, frame.at)
        self._sink.received(frame)

    def state_changed(self, state: LinkState) -> None:
        """Take a verdict on the line."""
        self.facts.link_changed(state)
        self._sink.state_changed(state)


def flight_ctrl(word: str = "2.12a", seed: int = 1, **sim: object) -> Callable[[], Simulation]:
    """What powers a FlightCtrl up."""
    return _aircraft(board="fc", fc=word, seed=seed, **sim)


def navi_ctrl(word: str = "0.24", flight: str = "2.12a", seed: int = 1, **sim: object) -> Callable[[], Simulation]:
    """What powers a NaviCtrl with a FlightCtrl behind it up."""
    return _aircraft(board="nc", nc=word, fc=flight, seed=seed, **sim)


def _aircraft(**sim: object) -> Callable[[], Simulation]:
    cfg = SimConfig.model_validate({"pilot_plan": PilotPlan.NOTHING, "calibrated": True, **sim})
    if cfg.pilot_plan is not PilotPlan.NOTHING:
        return lambda: Simulation(cfg)
    # Nobody flies it, so there is no physics to pay for.
    return lambda: Simulation(cfg, cast("World", GroundedAircraft()))


class Rig:
    """A running link.

    Attributes:
        log: everything it reported, where it has no other sink.
    """

    def __init__(self, link: Link, log: Log, socket: Socket, task: asyncio.Task[None]) -> None:
        self.link, self.log, self.socket, self.task = link, log, socket, task

    @property
    def condition(self) -> str:
        """The verdict on the line."""
        return self.link.condition.value

    async def until(self, claim: Callable[[], bool], within: float) -> float:
        """Wait for something to become true; returns how long it took [s].

        Raises:
            AssertionError: it did not in time.
        """
        try:
            return await wait_until(claim, within, step=0.005)
        except TimeoutError as late:
            raise AssertionError(f"{late}; link says {self.link.health().state}") from None

    async def until_up(self, within: float = 3.0) -> float:
        """Wait until the link is up; returns how long it took [s].

        Raises:
            AssertionError: it was not in time.
        """
        return await self.until(lambda: self.condition == "up", within)


@asynccontextmanager
async def rig(
    make: Callable[[], Simulation],
    *,
    seed: int = 1,
    right_baud: int = 57600,
    sink: LinkSink | None = None,
    guard: LineGuard | None = None,
    tick: float = ADAPTER_TIME,
    **cfg: object,
) -> AsyncIterator[Rig]:
    """A link that runs as long as the context lasts, in the time of the running loop.

    Args:
        right_baud: line rate at which bytes can be understood.
        sink: told everything, in place of the log.
        tick: how often bytes are carried [s].
    """
    log = Log()
    socket = Socket(make, seed=seed, right_baud=right_baud, tick=tick)
    watch = MotorWatch(sink or log)
    link = Link(
        LinkConfig.model_validate({"port": "/dev/rig", **cfg}),
        watch,
        opener=socket.open,
        clock=Clock(monotonic=asyncio.get_running_loop().time),
        motors_running=watch.facts.motors_running,
        guard=guard,
    )
    async with running(link.run(discover)) as task:
        yield Rig(link, log, socket, task)


def on_line(make: Callable[[], Simulation], **cfg: Any) -> Callable[[AsyncTest], Callable[..., None]]:
    """Run a test in virtual time on a link that is up: the test's first argument."""

    def decorate(test: AsyncTest) -> Callable[..., None]:
        @functools.wraps(test)
        async def run(**arguments: object) -> None:
            async with rig(make, **cfg) as r:
                await r.until_up()
                await test(r, **arguments)

        _, *others = inspect.signature(test).parameters.values()
        run.__signature__ = inspect.Signature(others)  # type: ignore[attr-defined]
        return virtually(run)

    return decorate
