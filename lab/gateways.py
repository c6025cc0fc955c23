"""`python -m lab gateways`: what a gateway adds in time and processor, and what it costs the daemon.

Simulator, daemon, gateways and whoever notes a time are processes of their own; the simulated pilot hovers over a
target that a rendered camera sees. The daemon alone and the daemon with a gateway follow each other in short parts, so
that what else the machine does falls on both, and each part with one is compared with those right before and after it.

`late` is from the stamp of an attitude to its arrival at the gateway's peer, `added` how much later that is than at a
client of the bus at the same time (`lab.rigs.gatewaypeers`).
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from typing import Any, Final, NamedTuple

import numpy as np

from lab.rigs.gatewaypeers import BUS, LOOKS, Arrivals, options_of, own_domain
from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.overtarget import VEHICLE, Hover, Setting, favour, hovering
from lab.rigs.processes import Program
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError

SETTLING: Final = 4.0
"""After a gateway has come, before anything is counted [s]: what ROS 2 takes to find others."""
LEAVING: Final = 1.0
"""The same after one has gone [s], and for what is under way at the end of a part."""
STEADY: Final = 10.0
"""After the pilot hovers, before the first part [s]: the eyes take half as much again once he holds the height."""
IMAGES: Final = 5.0
"""A second: the renderer is the simulator's, and takes a core at 15."""
LEAST_CAME: Final = 0.98
"""Of the attitudes on the bus; those at the edges of a part may fall into another one."""
MOST_CPU: Final = 15.0
"""Goal of the processor [% of a core]."""
MOST_RATIO: Final = 1.1
"""Goal of the daemon's processor, times its own without the gateway."""


class Part(NamedTuple):
    """A part of the measurement in which a gateway ran.

    Attributes:
        start: of what is counted [s; Unix time].
        end: of it [s; Unix time].
        gateway: processor of the gateway, as a share of a core.
        daemon: the same of the daemon.
        alone: the same of the daemon without a gateway, right before and after.
    """

    start: float
    end: float
    gateway: float
    daemon: float
    alone: float


def main(*, case: str | None = None, seconds: float = 7.0, rounds: int = 4, as_json: AsJson = False) -> int:
    """Measure gateways, six minutes for all. Goals: 15 % of a core, the daemon 1.1 times, nothing lost.

    Args:
        case: which gateway: mavlink, foxglove or ros2; all by default.
        seconds: counted of each part.
        rounds: parts with each gateway.

    Raises:
        ConfigError: there is no such gateway.
    """
    gateways = tuple(name for name in LOOKS if name != BUS)
    if case is not None and case not in gateways:
        raise ConfigError(f"--case {case}: there is {', '.join(gateways)}")
    own_domain()
    found = asyncio.run(measure(gateways if case is None else (case,), seconds, rounds))
    return show(found, ("case",), as_json=as_json)


async def measure(cases: Sequence[str], seconds: float, rounds: int) -> list[dict[str, Any]]:
    """Measure some gateways over one flight; the figures of each. See `main`."""
    ports, peers = {name: _free_port() for name in cases}, dict[str, Program]()
    async with hovering(Setting(fps=IMAGES, wind="none")) as hover, AsyncExitStack() as stack:
        for name in (BUS, *cases):
            words = ("-m", "lab.rigs.gatewaypeers", name, str(ports.get(name, 0)), VEHICLE, hover.endpoint)
            peers[name] = await Program.start(*words)
            stack.push_async_callback(peers[name].end, signal.SIGKILL)
            favour(peers[name].pid)
            await peers[name].first_line()
        await asyncio.sleep(STEADY)
        parts = await _parts(hover, ports, seconds, rounds)
        came = dict[str, Arrivals]()
        for name, peer in peers.items():
            peer.send_signal(signal.SIGTERM)
            came[name] = Arrivals.of((await peer.output())[1])
    load = {"load": round(os.getloadavg()[0], 1)}
    return [figures_of(name, parts[name], came[BUS], came[name]) | load for name in cases]


async def _parts(hover: Hover, ports: Mapping[str, int], seconds: float, rounds: int) -> dict[str, list[Part]]:
    """Measure by turns, with the daemon alone between any two gateways."""
    parts: dict[str, list[Part]] = {name: [] for name in ports}
    before = await _share(hover.daemon.cpu_s, seconds)
    for _ in range(rounds):
        for name, port in ports.items():
            async with gateway_process(name, hover.endpoint, VEHICLE, *options_of(name, port)) as gateway:
                await asyncio.sleep(SETTLING)
                used, start = gateway.cpu_s(), time.time()
                daemon = await _share(hover.daemon.cpu_s, seconds)
                end = time.time()
                share = (gateway.cpu_s() - used) / (end - start)
                await asyncio.sleep(LEAVING)
            await asyncio.sleep(LEAVING)
            after = await _share(hover.daemon.cpu_s, seconds)
            parts[name].append(Part(start, end, share, daemon, (before + after) / 2))
            before = after
    return parts


def figures_of(name: str, parts: Sequence[Part], bus: Arrivals, peer: Arrivals) -> dict[str, Any]:
    """The figures of a gateway, by the parts in which it ran and what came on the bus and at its peer."""
    on_bus, late = (
        [1000 * late for at, late in one.late if any(part.start <= at < part.end for part in parts)]
        for one in (bus, peer)
    )
    came = len(late) / len(on_bus)
    quantiles = {
        f"{what}_p{part}_ms": round(float(np.percentile(values, part)), 2)
        for what, values in (("late", late), ("bus_late", on_bus))
        for part in (50, 99)
        if values
    }
    seconds = {second for part in parts for second in range(int(part.start) + 1, int(part.end))}
    figures: dict[str, Any] = {
        "case": name,
        "came": round(came, 3),
        **quantiles,
        "added_p50_ms": round(float(np.median(late) - np.median(on_bus)), 2) if late else None,
        "gateway_cpu_percent": round(100 * float(np.median([part.gateway for part in parts])), 1),
        "messages_per_s": round(float(np.mean([peer.counts[second] for second in seconds])), 1),
        "daemon_cpu_percent": round(100 * float(np.median([part.alone for part in parts])), 1),
        "daemon_ratio": round(float(np.median([part.daemon / part.alone for part in parts])), 3),
    }
    is_cheap = figures["gateway_cpu_percent"] <= MOST_CPU and figures["daemon_ratio"] <= MOST_RATIO
    return figures | {"holds": came >= LEAST_CAME and is_cheap}


async def _share(cpu_s: Callable[[], float], seconds: float) -> float:
    """Share of a core that a process uses for some time."""
    before, start = cpu_s(), time.monotonic()
    await asyncio.sleep(seconds)
    return (cpu_s() - before) / (time.monotonic() - start)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
