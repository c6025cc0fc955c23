"""`python -m lab gateways`: what a gateway adds in time and processor, and what it costs the daemon.

Simulator, daemon and gateway are processes of their own; the simulated pilot hovers over a target that a rendered
camera sees. Parts without and with a peer of the gateway follow each other, so that what else the machine does falls
on both. What is measured beside a load is the load's: `woken_late` is how late a thread that only sleeps was woken.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any, Final

import numpy as np

from lab.rigs.gatewaypeers import PEERS, Peer, own_domain
from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.overtarget import VEHICLE, Setting, hovering
from lab.rigs.sleeper import Sleeper
from mkdaemon.cli.arguments import AsJson
from mkdaemon.client import Vehicle
from mkdaemon.errors import ConfigError
from mkdaemon.stamp import Stamp

SETTLING: Final = 4.0
"""After a peer has come or gone, before anything is counted [s]: what ROS 2 takes to find others."""
IMAGES: Final = 5.0
"""A second: the renderer is the simulator's, and takes a core at 15."""


def main(*, case: str | None = None, seconds: float = 10.0, rounds: int = 3, as_json: AsJson = False) -> int:
    """Measure gateways, two minutes each. The goals: p99 <= 5 ms, <= 15 % of a core, the daemon <= 1.1 times.

    Args:
        case: which gateway: mavlink, foxglove or ros2; all by default.
        seconds: counted of each part.
        rounds: parts without and with a peer.

    Raises:
        ConfigError: there is no such gateway.
    """
    if case is not None and case not in PEERS:
        raise ConfigError(f"--case {case}: there is {', '.join(PEERS)}")
    own_domain()
    are_within = True
    for name in PEERS if case is None else (case,):
        figures = asyncio.run(measure(name, PEERS[name], seconds, rounds))
        are_within &= figures["is_within"]
        if as_json:
            print(json.dumps(figures), flush=True)
        else:
            print("\n".join(f"{key:<24} {value}" for key, value in figures.items()), flush=True)
    return 0 if are_within else 1


async def measure(name: str, peer: Peer, seconds: float, rounds: int) -> dict[str, Any]:
    """Measure one gateway; the figures. See `main`."""
    latencies: list[float] = []
    shares: dict[str, list[float]] = {"alone": [], "with": [], "gateway": [], "rate": []}
    port = _free_port()
    with Sleeper() as sleeper:
        async with hovering(Setting(fps=IMAGES, wind="none")) as hover:
            for _ in range(rounds):
                await asyncio.sleep(SETTLING)
                shares["alone"].append(await _share(hover.daemon.cpu_s, seconds))
                async with gateway_process(name, hover.endpoint, VEHICLE, *peer.options(port)) as gateway:
                    async with peer.open(port) as arrivals, _seen(hover.client, peer.number) as seen:
                        await asyncio.sleep(SETTLING)
                        seen.clear()
                        before, count, start = gateway.cpu_s(), arrivals.count, time.monotonic()
                        shares["with"].append(await _share(hover.daemon.cpu_s, seconds))
                        passed = time.monotonic() - start
                        shares["gateway"].append((gateway.cpu_s() - before) / passed)
                        shares["rate"].append((arrivals.count - count) / passed)
                        await asyncio.sleep(1.0)  # for what is under way
                    latencies += [arrivals.at[key] - at for key, at in seen.items() if key in arrivals.at]
    ratio = float(np.median(shares["with"]) / np.median(shares["alone"]))
    p50, p99 = (1000 * float(np.percentile(latencies, part)) for part in (50, 99))
    cpu = 100 * float(np.median(shares["gateway"]))
    return {
        "case": name,
        "values": len(latencies),
        "latency_p50_ms": round(p50, 2),
        "latency_p99_ms": round(p99, 2),
        "gateway_cpu_percent": round(cpu, 1),
        "messages_per_s": round(float(np.median(shares["rate"])), 1),
        "daemon_cpu_percent": round(100 * float(np.median(shares["alone"])), 1),
        "daemon_ratio": round(ratio, 3),
        "woken_late_p50_ms": sleeper.percentile(50),
        "woken_late_p99_ms": sleeper.percentile(99),
        "load": round(os.getloadavg()[0], 1),
        "is_within": p99 <= 5.0 and cpu <= 15.0 and ratio <= 1.1,
    }


async def _share(cpu_s: Callable[[], float], seconds: float) -> float:
    """Share of a core that a process uses for some time."""
    before, start = cpu_s(), time.monotonic()
    await asyncio.sleep(seconds)
    return (cpu_s() - before) / (time.monotonic() - start)


@asynccontextmanager
async def _seen(client: Vehicle, number: Callable[[Stamp], int]) -> AsyncIterator[dict[int, float]]:
    """When attitudes came to a client of the bus, by the numbers of their stamps."""
    seen: dict[int, float] = {}

    async def listen() -> None:
        async for value in client.state.attitude():
            seen[number(value.stamp)] = time.monotonic()

    listening = asyncio.create_task(listen(), name="observer")
    try:
        yield seen
    finally:
        listening.cancel()
        await asyncio.gather(listening, return_exceptions=True)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
