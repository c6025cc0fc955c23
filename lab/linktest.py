"""`python -m lab linktest`: whether `mkctl linktest` finds what was put into a line. Virtual time, seeded.

Each line is measured as `mkctl linktest` measures it. Losses and latencies found have to agree within 10 % with what
became of every single conversation (`lab.link.fates`).
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, cast
from unittest.mock import Mock

from cyclopts import Parameter
from pydantic import BaseModel

from lab.link.cases import FULL, RADIO, Case, configurations, running_link, steer_steadily
from lab.link.fates import Fate, Tracer
from lab.rigs.grounded import GroundedAircraft
from lab.rigs.waiting import in_virtual_time
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.client.linktest.advice import judge
from mkdaemon.client.linktest.measures import LoadRun, measure
from mkdaemon.client.linktest.probes import PATTERNS, TIMEOUT, Ledger, ProbeKind
from mkdaemon.clock import Clock
from mkdaemon.daemon.sink import BusSink
from mkdaemon.errors import ConfigError
from mkdaemon.telemetry.link import LinkHealth
from mkdaemon.telemetry.traffic import FrameSample
from mkdaemon.view.linkpicture import link_picture
from mksim.physics.world import World

LIMIT: Final = 0.10
"""Largest difference between what was found and what happened, as a share of it."""
LONG: Final = 60.0
"""Length by default [s]."""
_BOARDS: Final = {"board": "nc", "nc": "2.14", "fc": "2.14"}
_POOR: Final = {"kind": "xbee", "loss": 0.05, "mean_burst": 2.0}
_LINES: Final[dict[str, dict[str, Any]]] = {
    "wire": {},
    "timer": {"radio": {"to_host": {"usb_timer": 0.016}}},
    "radio": {"radio": RADIO},
    "poor radio": {"radio": {"to_board": _POOR, "to_host": {**_POOR, "usb_timer": 0.001}}},
}


def main(
    *,
    seconds: Annotated[float, Parameter(help="Length of each measurement [s].")] = LONG,
    line: Annotated[str | None, Parameter(help="One line; all of them by default.")] = None,
    picture: Annotated[
        Path | None, Parameter(help="Draw the poor radio under light and full load into this SVG.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Measure lines whose losses and latencies are known; exit code 1 where 10 % are exceeded.

    Half a minute for all. `--picture` alone draws a minute of each load, in ten seconds.

    Raises:
        ConfigError: no such line.
    """
    if picture is not None:
        picture.write_text(draw(60.0), encoding="utf-8")
        print(picture)
        return 0
    if line is not None and line not in _LINES:
        raise ConfigError(f"no line {line!r}: choose from {', '.join(_LINES)}")
    rows = [{"line": name} | found_and_put_in(name, seconds) for name in ([line] if line else _LINES)]
    return show(rows, ("line",), as_json=as_json)


class MeasuredLink(NamedTuple):
    """What was found, and what happened.

    Attributes:
        run: as `mkctl linktest` has it.
        echoes: what became of every link test.
        sticks: what became of every stick frame.
    """

    run: LoadRun
    echoes: list[Fate]
    sticks: list[Fate]


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


@in_virtual_time
async def measure_link(case: Case, seconds: float) -> MeasuredLink:
    """Measure the line of a case for so long [s]."""
    sim, options = configurations(case)
    loop = asyncio.get_running_loop()
    tracer, bus, nobody = Tracer(sim, cast("World", GroundedAircraft())), _LedgerBus(), Mock()
    sink = BusSink(cast("Any", bus), nobody.feed, nobody, nobody, nobody, Clock(monotonic=loop.time))
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


def case_of(name: str, *, full: bool = False) -> Case:
    """One of the lines under light or full load."""
    sim = {**_BOARDS, **_LINES[name]}
    if full:
        return Case(name, 60, FULL, setpoint_hz=15, sim=sim)
    return Case(name, 60, {"osd": 500.0}, sim=sim)


def draw(seconds: float) -> str:
    """The picture of a minute over the poor radio."""
    runs = []
    for load, full in (("light", False), ("full", True)):
        run = measure_link(case_of("poor radio", full=full), seconds).run
        runs.append(LoadRun("poor radio, simulated", load, run.control_hz, run.probes))
    verdict = judge(runs)
    return link_picture(runs, f"Link test: {verdict.grade}. {verdict.reason}")


def found_and_put_in(name: str, seconds: float) -> dict[str, Any]:
    """Measure a line under light load, and compare."""
    measured = measure_link(case_of(name), seconds)
    found = measure(measured.run.of(ProbeKind.ECHO))
    happened_loss, happened_ms = happened(measured.echoes)
    worst = max(_apart(found.loss_percent, 100 * happened_loss), _apart(found.mean_ms or 0.0, happened_ms))
    return {
        "sent": found.sent,
        "loss_percent": round(found.loss_percent, 3),
        "loss_happened_percent": round(100 * happened_loss, 3),
        "mean_ms": round(found.mean_ms or 0.0, 2),
        "mean_happened_ms": round(happened_ms, 2),
        "worst": round(worst, 4),
        "holds": worst <= LIMIT,
    }


def happened(fates: list[Fate]) -> tuple[float, float]:
    """Share of conversations that were lost, and mean time of the others [ms]."""
    times = [fate.heard - fate.asked for fate in fates if fate.heard is not None and fate.heard - fate.asked <= TIMEOUT]
    return 1.0 - len(times) / len(fates), 1000 * sum(times) / len(times)


def _apart(found: float, put_in: float) -> float:
    return 0.0 if found == put_in else abs(found - put_in) / put_in if put_in else 1.0
