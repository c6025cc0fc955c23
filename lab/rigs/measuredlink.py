"""A line with simulated boards in virtual time, measured as `mkctl linktest` measures it, and the truth beside it."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

from pydantic import BaseModel

from lab.link.cases import Case, configurations, running_link, steer_steadily
from lab.link.fates import Fate, Tracer
from lab.rigs.grounded import GroundedAircraft
from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probes import PATTERNS, Ledger
from mkdaemon.clock import Clock
from mkdaemon.daemon.sink import BusSink
from mkdaemon.telemetry.link import LinkHealth
from mkdaemon.telemetry.traffic import FrameSample
from mkdaemon.virtualtime import run_virtually
from mksim.physics.world import World


@dataclass(frozen=True, slots=True)
class MeasuredLink:
    """What was found, and what happened.

    Attributes:
        run: as `mkctl linktest` has it.
        echoes: what became of every link test.
        sticks: what became of every stick frame.
    """

    run: LoadRun
    echoes: list[Fate]
    sticks: list[Fate]


class _Nobody:
    """Takes everything, and does nothing."""

    def __getattr__(self, _: str) -> Any:
        return lambda *_args, **_more: None


class _LedgerBus:
    """A bus on which only the ledger listens."""

    def __init__(self) -> None:
        self.ledger: Ledger | None = None
        self._keys = tuple(pattern.replace("/*/", "/") for pattern in PATTERNS)

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Hand a frame to the ledger, if it follows such."""
        if self.ledger is not None and suffix == "link/health":
            self.ledger.take_replaced(cast("LinkHealth", value).stick_frames.replaced)
        direction, _, rest = suffix.partition("/")
        key = f"{direction}/{rest.rpartition('/')[2]}"
        if self.ledger is not None and (suffix in self._keys or key in self._keys):
            self.ledger.take(suffix, cast("FrameSample", value))


def measure_link(case: Case, seconds: float) -> MeasuredLink:
    """Measure the line of a case for so long [s]."""
    return run_virtually(_measure(case, seconds))


async def _measure(case: Case, seconds: float) -> MeasuredLink:
    sim, options = configurations(case)
    loop = asyncio.get_running_loop()
    tracer, bus, nobody = Tracer(sim, cast("World", GroundedAircraft())), _LedgerBus(), cast("Any", _Nobody())
    facts = cast("Any", SimpleNamespace(link=None))
    sink = BusSink(cast("Any", bus), nobody.feed, facts, nobody, nobody, Clock(monotonic=loop.time))
    async with running_link(case, tracer, options, cast("Any", sink)) as running:
        began, bus.ledger = loop.time(), Ledger()
        await steer_steadily(running.link, case, seconds)
        ended = loop.time()
        bus.ledger.end()
        await asyncio.sleep(0.5)
    return MeasuredLink(
        LoadRun(case.name, case.name, case.setpoint_hz, tuple(bus.ledger.probes())),
        [fate for fate in tracer.echoes if began <= fate.asked < ended],
        [fate for fate in tracer.sticks if began <= fate.asked < ended],
    )
