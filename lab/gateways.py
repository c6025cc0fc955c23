"""`python -m lab gateways`: what a gateway adds in time and processor, and what it costs the daemon.

Simulator, daemon and gateway are processes of their own; the simulated pilot hovers over a target that a rendered
camera sees. Parts without and with a peer of the gateway follow each other, so that what else the machine does falls
on both. What is measured beside a load is the load's: `woken_late` is how late a thread that only sleeps was woken.
"""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Final

import numpy as np

from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.overtarget import VEHICLE, Setting, hovering
from lab.rigs.sleeper import Sleeper
from mkdaemon.cli.arguments import AsJson
from mkdaemon.client import Vehicle
from mkdaemon.errors import ConfigError

SETTLING: Final = 2.0
"""After a peer has come or gone, before anything is counted [s]."""
WHOLE_BOOT: Final = 1 << 32
"""`time_boot_ms` begins again after so many."""


@dataclass(slots=True)
class Arrivals:
    """When values came through a gateway, by what tells which value it is.

    Attributes:
        at: for each value, when it came [s; monotonic].
        count: messages of every kind.
    """

    at: dict[int, float] = field(default_factory=dict)
    count: int = 0


Peer = Callable[[int], AbstractAsyncContextManager[Arrivals]]
"""Connects to a gateway at a port of this machine, asks for everything at full rate, and notes what comes."""


@dataclass(frozen=True, slots=True)
class Case:
    """A gateway that can be measured.

    Attributes:
        options: of the command, by the port at which its peer finds it.
        peer: what it is measured with; its arrivals are known by the milliseconds of an attitude's stamp.
    """

    options: Callable[[int], Sequence[str]]
    peer: Peer


def main(*, case: str = "mavlink", seconds: float = 10.0, rounds: int = 3, as_json: AsJson = False) -> int:
    """Measure a gateway; a minute or two. The goals: p99 <= 5 ms, <= 15 % of a core, the daemon <= 1.1 times.

    Args:
        case: which gateway: mavlink, foxglove or ros2.
        seconds: counted of each part.
        rounds: parts without and with a peer; ros2 has one.

    Raises:
        ConfigError: there is no such gateway.
    """
    match case:
        case "foxglove":
            figures = import_module("lab.gateways_foxglove").measure(seconds, rounds)
        case "ros2":
            figures = import_module("lab.gateways_ros2").measure(seconds)
        case _ if case in CASES:
            figures = asyncio.run(measure(case, CASES[case], seconds, rounds))
        case _:
            raise ConfigError(f"--case {case}: there is {', '.join((*CASES, 'foxglove', 'ros2'))}")
    if as_json:
        print(json.dumps(figures))
    else:
        for name, value in figures.items():
            print(f"{name:<24} {value}")
    return 0 if figures["is_within"] else 1


async def measure(name: str, case: Case, seconds: float, rounds: int) -> dict[str, Any]:
    """Measure one gateway; the figures. See `main`."""
    latencies: list[float] = []
    shares: dict[str, list[float]] = {"alone": [], "with": [], "gateway": [], "rate": []}
    port = _free_port()
    with Sleeper() as sleeper:
        async with hovering(Setting(fps=15.0, wind="none")) as hover:
            for _ in range(rounds):
                shares["alone"].append(await _share(hover.daemon.cpu_s, seconds))
                async with gateway_process(name, hover.endpoint, VEHICLE, *case.options(port)) as gateway:
                    async with case.peer(port) as arrivals, _seen(hover.client) as seen:
                        await asyncio.sleep(SETTLING)
                        seen.clear()
                        before, count, start = gateway.cpu_s(), arrivals.count, time.monotonic()
                        shares["with"].append(await _share(hover.daemon.cpu_s, seconds))
                        passed = time.monotonic() - start
                        shares["gateway"].append((gateway.cpu_s() - before) / passed)
                        shares["rate"].append((arrivals.count - count) / passed)
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
        "daemon_ratio": round(ratio, 3),
        "woken_late_p50_ms": sleeper.percentile(50),
        "woken_late_p99_ms": sleeper.percentile(99),
        "is_within": p99 <= 5.0 and cpu <= 15.0 and ratio <= 1.1,
    }


async def _share(cpu_s: Callable[[], float], seconds: float) -> float:
    """Share of a core that a process uses for some time."""
    before, start = cpu_s(), time.monotonic()
    await asyncio.sleep(seconds)
    return (cpu_s() - before) / (time.monotonic() - start)


@asynccontextmanager
async def _seen(client: Vehicle) -> AsyncIterator[dict[int, float]]:
    """When attitudes came to a client of the bus, by the milliseconds of their stamps."""
    seen: dict[int, float] = {}

    async def listen() -> None:
        async for value in client.state.attitude():
            seen[int(value.stamp.monotonic * 1000) % WHOLE_BOOT] = time.monotonic()

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


@asynccontextmanager
async def _ground_station(port: int) -> AsyncIterator[Arrivals]:
    """A ground station over UDP that asks for every message as often as it can come."""
    from pymavlink.dialects.v20 import all as mavlink

    from mkdaemon.gateways.mavlink.framing import Counts, Decoder, Encoder
    from mkdaemon.gateways.mavlink.telemetry import IDS

    arrivals, decoder, encoder = Arrivals(), Decoder(Counts(), None), Encoder(255, None)

    class Ears(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, addr: Any) -> None:
            now = time.monotonic()
            for message in decoder.datagram(data, 0.0):
                arrivals.count += 1
                if message.get_type() == "ATTITUDE":
                    arrivals.at[message.time_boot_ms] = now

    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(Ears, remote_addr=("127.0.0.1", port))

    def send(message: Any) -> None:
        transport.sendto(encoder.encode(message, 0.0))

    async def beat() -> None:
        while True:
            send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            await asyncio.sleep(1.0)

    beating = asyncio.create_task(beat(), name="heartbeat")
    try:
        await asyncio.sleep(0.1)
        for number in IDS:
            fastest = mavlink.MAVLink_command_long_message(1, 1, 511, 0, number, 2000, *[0] * 5)
            send(fastest)
        yield arrivals
    finally:
        beating.cancel()
        transport.close()


CASES: Final = {
    "mavlink": Case(lambda port: ("--link", f"udpin:127.0.0.1:{port}"), _ground_station),
}
"""Gateways that are measured over the hovering aircraft; a further one is one line here and its peer."""
