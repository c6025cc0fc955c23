"""`python -m lab gateways`: what a gateway adds in time and processor, and what it costs the daemon.

Simulator, daemon, gateways and whoever notes a time are processes of their own; the simulated pilot hovers over a
target that a rendered camera sees. The daemon alone and the daemon with a gateway follow each other in short parts, so
that what else the machine does falls on both, and each part with one is compared with those right before and after it.

`added` is from a value's arrival at a client of the bus to its arrival at the peer's socket, by stamps that no load
delays (`lab.rigs.stamped`). `floor` is the same, of the same values, for the least that a process between the two can
do (`lab.rigs.gatewaywitness`): what this machine takes for any gateway. `woken_late` is how late an ordinary thread was
woken that only sleeps: a peer that shares the cores has a value later by as much.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from lab.rigs.gatewaypeers import PEERS, own_domain
from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.overtarget import VEHICLE, Hover, Setting, favour, hovering
from lab.rigs.sleeper import Sleeper
from lab.rigs.stamped import NS, Arrivals
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
INSTRUMENT: Final = 60.0
"""Longest start and end of a program that notes times [s]."""
MOST_OF_FLOOR: Final = 2.0
"""Goal of the 99th percentile added, times the relay's of the same values."""
MOST_CPU: Final = 15.0
"""Goal of the processor [% of a core]."""
MOST_RATIO: Final = 1.1
"""Goal of the daemon's processor, times its own without the gateway."""


class Part(NamedTuple):
    """A part of the measurement in which a gateway ran.

    Attributes:
        start: of what is counted [ns; Unix time].
        end: of it [ns; Unix time].
        gateway: processor of the gateway, as a share of a core.
        daemon: the same of the daemon.
        alone: the same of the daemon without a gateway, right before and after.
    """

    start: int
    end: int
    gateway: float
    daemon: float
    alone: float


class Value(NamedTuple):
    """An attitude on the bus.

    Attributes:
        monotonic: the daemon's time of it [s].
        wall: the same by the system clock [s].
        at: when it came [ns; Unix time].
    """

    monotonic: float
    wall: float
    at: int


@dataclass(slots=True)
class Instrument:
    """A program that notes times, and what it told at its end."""

    told: dict[str, Any] = field(default_factory=dict)


def main(*, case: str | None = None, seconds: float = 7.0, rounds: int = 4, as_json: AsJson = False) -> int:
    """Measure gateways, six minutes for all. Goals: p99 2 times the relay's, 15 % of a core, the daemon 1.1 times.

    Args:
        case: which gateway: mavlink, foxglove or ros2; all by default.
        seconds: counted of each part.
        rounds: parts with each gateway.

    Raises:
        ConfigError: there is no such gateway.
    """
    if case is not None and case not in PEERS:
        raise ConfigError(f"--case {case}: there is {', '.join(PEERS)}")
    own_domain()
    found = asyncio.run(measure(tuple(PEERS) if case is None else (case,), seconds, rounds))
    return show(found, ("case",), as_json=as_json)


async def measure(cases: Sequence[str], seconds: float, rounds: int) -> list[dict[str, Any]]:
    """Measure some gateways over one flight; the figures of each. See `main`."""
    ports = {name: _free_port() for name in (*cases, "witness")}
    told: dict[str, Instrument] = {}
    with Sleeper() as sleeper:
        async with hovering(Setting(fps=IMAGES, wind="none")) as hover, AsyncExitStack() as stack:
            bus = (hover.endpoint, VEHICLE, str(ports["witness"]))
            for role in ("witness", "relay"):
                told[role] = await stack.enter_async_context(_instrument("lab.rigs.gatewaywitness", role, *bus))
            for name in cases:
                peer = ("lab.rigs.gatewaypeers", name, str(ports[name]), VEHICLE)
                told[name] = await stack.enter_async_context(_instrument(*peer))
            await asyncio.sleep(STEADY)
            parts = await _parts(hover, {name: ports[name] for name in cases}, seconds, rounds)
    machine = {
        "woken_late_p50_ms": sleeper.percentile(50),
        "woken_late_p99_ms": sleeper.percentile(99),
        "instruments_go_first": told["witness"].told["is_first"],
        "load": round(os.getloadavg()[0], 1),
    }
    seen = [Value(*value) for value in told["witness"].told["bus"]]
    relayed = {_exactly(one): one.at for one in (Value(*value) for value in told["witness"].told["relay"])}
    return [figures_of(name, parts[name], seen, relayed, Arrivals.of(told[name].told)) | machine for name in cases]


async def _parts(hover: Hover, ports: Mapping[str, int], seconds: float, rounds: int) -> dict[str, list[Part]]:
    """Measure by turns, with the daemon alone between any two gateways."""
    parts: dict[str, list[Part]] = {name: [] for name in ports}
    before = await _share(hover.daemon.cpu_s, seconds)
    for _ in range(rounds):
        for name, port in ports.items():
            async with gateway_process(name, hover.endpoint, VEHICLE, *PEERS[name].options(port)) as gateway:
                await asyncio.sleep(SETTLING)
                used, start = gateway.cpu_s(), time.time_ns()
                daemon = await _share(hover.daemon.cpu_s, seconds)
                end = time.time_ns()
                share = (gateway.cpu_s() - used) / ((end - start) / NS)
                await asyncio.sleep(LEAVING)
            await asyncio.sleep(LEAVING)
            after = await _share(hover.daemon.cpu_s, seconds)
            parts[name].append(Part(start, end, share, daemon, (before + after) / 2))
            before = after
    return parts


def figures_of(
    name: str, parts: Sequence[Part], seen: Iterable[Value], relayed: Mapping[int, int], peer: Arrivals
) -> dict[str, Any]:
    """The figures of a gateway.

    Args:
        name: of it.
        parts: in which it ran.
        seen: every attitude on the bus.
        relayed: when the relay's copy of each came [ns], by `_exactly`.
        peer: what came at the peer.
    """
    number = PEERS[name].number
    values = [one for one in seen if any(part.start <= one.at < part.end for part in parts)]
    came = [(one, _found(peer.at, number(one.monotonic, one.wall))) for one in values]
    added = [(at - one.at) / 1e6 for one, at in came if at is not None]
    floor = [(relayed[_exactly(one)] - one.at) / 1e6 for one in values if _exactly(one) in relayed]
    ratios = sorted(part.daemon / part.alone for part in parts)
    seconds = {second for part in parts for second in range(part.start // NS + 1, part.end // NS)}
    figures: dict[str, Any] = {
        "case": name,
        "values": len(values),
        "lost": len(values) - len(added),
        "added_p50_ms": _percentile(added, 50),
        "added_p99_ms": _percentile(added, 99),
        "floor_p50_ms": _percentile(floor, 50),
        "floor_p99_ms": _percentile(floor, 99),
        "p99_of_floor": round(_percentile(added, 99) / max(_percentile(floor, 99), 0.01), 2),
        "gateway_cpu_percent": round(100 * float(np.median([part.gateway for part in parts])), 1),
        "messages_per_s": round(float(np.mean([peer.counts[second] for second in seconds])), 1),
        "daemon_cpu_percent": round(100 * float(np.median([part.alone for part in parts])), 1),
        "daemon_ratio": round(float(np.median(ratios)), 3),
        "daemon_ratios": [round(ratio, 3) for ratio in ratios],
    }
    goals = (("p99_of_floor", MOST_OF_FLOOR), ("gateway_cpu_percent", MOST_CPU), ("daemon_ratio", MOST_RATIO))
    return figures | {"holds": not figures["lost"] and all(figures[key] <= most for key, most in goals)}


def _exactly(value: Value) -> int:
    """Tells which attitude one is among those of one daemon."""
    return round(value.monotonic * 1e9)


def _found(at: Mapping[int, int], number: int) -> int | None:
    """When the attitude of a number came; each system rounds the time in it differently, so by its neighbours too."""
    return next((at[near] for near in (number, number - 1, number + 1) if near in at), None)


def _percentile(values: Sequence[float], part: float) -> float:
    return round(float(np.percentile(values, part)), 2)


async def _share(cpu_s: Callable[[], float], seconds: float) -> float:
    """Share of a core that a process uses for some time."""
    before, start = cpu_s(), time.monotonic()
    await asyncio.sleep(seconds)
    return (cpu_s() - before) / (time.monotonic() - start)


@asynccontextmanager
async def _instrument(module: str, *arguments: str) -> AsyncIterator[Instrument]:
    """A program that notes times while the context lasts; then `told` has what it tells.

    Raises:
        TimeoutError: it did not begin, or did not end.
    """
    instrument = Instrument()
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", module, *arguments),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    favour(process.pid)
    assert process.stdout is not None
    try:
        async with asyncio.timeout(INSTRUMENT):
            if await process.stdout.readline() != b"ready\n":
                msg = f"{module} {arguments[0]} ended"
                raise TimeoutError(msg)
        yield instrument
        async with asyncio.timeout(INSTRUMENT):
            out, _ = await process.communicate(b"")
        instrument.told = json.loads(out)
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
