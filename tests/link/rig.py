"""A link in virtual time, with simulated boards at the other end and everything it reports kept."""

from __future__ import annotations

import asyncio
import inspect
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

from lab.rigs.boardport import Socket
from lab.rigs.virtualloop import run_virtually
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.config.sim import PilotPlan, SimConfig
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import Lost, Received, Sent
from mkdaemon.sim.simulation import Simulation
from mkdaemon.telemetry.link import LinkHealth, LinkState, LinkTraffic


def virtually(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    """Run a test in virtual time (pytest sees a plain function with the same arguments)."""

    def run(**arguments: object) -> None:
        run_virtually(test(**arguments))  # type: ignore[arg-type]

    run.__name__, run.__doc__ = test.__name__, test.__doc__
    run.__signature__ = inspect.signature(test)  # type: ignore[attr-defined]
    return run


class Log:
    """A sink that keeps everything."""

    def __init__(self) -> None:
        self.rx: list[Received] = []
        self.tx: list[Sent] = []
        self.lost: list[Lost] = []
        self.states: list[LinkState] = []
        self.healths: list[LinkHealth] = []
        self.traffics: list[LinkTraffic] = []

    def received(self, frame: Received) -> None:
        self.rx.append(frame)

    def sent(self, frame: Sent) -> None:
        self.tx.append(frame)

    def dropped(self, loss: Lost) -> None:
        self.lost.append(loss)

    def state_changed(self, state: LinkState) -> None:
        self.states.append(state)

    def health_measured(self, health: LinkHealth) -> None:
        self.healths.append(health)

    def traffic_counted(self, traffic: LinkTraffic) -> None:
        self.traffics.append(traffic)

    def kinds(self, since: float = 0.0) -> Counter[str]:
        return Counter(frame.frame.id for frame in self.rx if frame.at >= since)


def flight_ctrl(word: str = "2.12a", seed: int = 1, **sim: object) -> Callable[[], Simulation]:
    return _aircraft(board="fc", fc=word, seed=seed, **sim)


def navi_ctrl(word: str = "0.24", flight: str = "2.12a", seed: int = 1, **sim: object) -> Callable[[], Simulation]:
    return _aircraft(board="nc", nc=word, fc=flight, seed=seed, **sim)


def _aircraft(**sim: object) -> Callable[[], Simulation]:
    cfg = SimConfig.model_validate({"pilot_plan": PilotPlan.NOTHING, "calibrated": True, **sim})
    return lambda: Simulation(cfg)


class Rig:
    def __init__(self, link: Link, log: Log, socket: Socket, task: asyncio.Task[None]) -> None:
        self.link, self.log, self.socket, self.task = link, log, socket, task

    @property
    def condition(self) -> str:
        return self.link.health().state.condition.value

    async def until(self, claim: Callable[[], bool], within: float) -> float:
        """Wait for something to become true; returns how long it took [s]."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        while not claim():
            if loop.time() - began > within:
                raise AssertionError(f"not within {within} s; link says {self.link.health().state}")
            await asyncio.sleep(0.005)
        return loop.time() - began

    async def until_up(self, within: float = 3.0) -> float:
        return await self.until(lambda: self.condition == "up", within)


@asynccontextmanager
async def rig(
    make: Callable[[], Simulation], *, seed: int = 1, right_baud: int = 57600, **cfg: object
) -> AsyncIterator[Rig]:
    log = Log()
    socket = Socket(make, seed=seed, right_baud=right_baud)
    link = Link(
        LinkConfig.model_validate({"port": "/dev/rig", **cfg}),
        log,
        opener=socket.open,
        clock=Clock(monotonic=asyncio.get_running_loop().time),
    )
    task = asyncio.create_task(link.run())
    try:
        yield Rig(link, log, socket, task)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
