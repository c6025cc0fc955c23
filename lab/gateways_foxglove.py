"""`python -m lab gateways --case foxglove`: what the Foxglove gateway adds in time, and what it and the daemon use.

Real time: a simulated FlightCtrl on a pseudo terminal, `mkdaemon run` and the gateway as processes, a client that
streams sticks, and a viewer that subscribes to every channel. What is measured beside a load is the load's: the figures
have the time by which a thread that only sleeps was woken late.
"""

from __future__ import annotations

import asyncio
import json
import os
import statistics
import struct
import sys
import tempfile
import time
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

import msgpack
import websockets
import zenoh

from lab.rigs.processes import (
    PROGRAM,
    START,
    VEHICLE,
    DaemonProcess,
    connected,
    cpu_of,
    daemon_process,
    wait_for_control,
)
from lab.rigs.sleeper import Sleeper
from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.record.entry import nanoseconds
from mksim.config import PilotPlan, SimConfig
from mksim.runtime import Runtime
from mksim.simulation import Simulation

SETTLING: Final = 3.0
"""After a viewer has come or gone, before anything is counted [s]."""
MESSAGE: Final = 1
"""First byte of a message with data; its channel's subscription and its log time follow."""


def measure(seconds: float = 10.0, rounds: int = 4) -> dict[str, Any]:
    """Measure the gateway, two minutes.

    Args:
        seconds: counted of each part.
        rounds: parts without and with a viewer.

    Returns:
        `added_p50_ms` and `added_p99_ms`: from a value's arrival at a client of the bus to its arrival at a viewer,
        both in one process of their own [ms]; `woken_p99_ms`: how late a thread that only sleeps was woken there [ms];
        `gateway_percent`: processor time of the gateway [% of a core] with a viewer of everything,
        `gateway_idle_percent` with one that is subscribed to nothing; `daemon_percent` alone, `daemon_viewed_percent`,
        and their `daemon_ratio`; `messages_per_s`; `load` of the machine; `is_within` the goals.

    Raises:
        TimeoutError: something did not start.
    """
    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(_measure(Path(folder), seconds, rounds))


async def _measure(folder: Path, seconds: float, rounds: int) -> dict[str, Any]:
    simulation = Simulation(SimConfig(board="fc", pilot_plan=PilotPlan.NOTHING, calibrated=True))
    async with (
        Runtime(simulation).serve() as runtime,
        daemon_process(f"pty:{runtime.port}", folder) as daemon,
        connected(daemon.endpoint) as uav,
    ):
        await wait_for_control(uav)
        steering = asyncio.create_task(_steer(uav), name="sticks")
        try:
            found = await _costs(daemon, seconds, rounds)
            found |= await _observed(daemon.endpoint, seconds)
            is_cheap = found["gateway_percent"] <= 15.0 and found["daemon_ratio"] <= 1.1
            return found | {"is_within": is_cheap and found["added_p99_ms"] <= 5.0}
        finally:
            steering.cancel()
            await asyncio.gather(steering, return_exceptions=True)


async def _costs(daemon: DaemonProcess, seconds: float, rounds: int) -> dict[str, Any]:
    """Processor time of the daemon and the gateway, without a viewer and with one, in turn."""
    alone, viewed, gateway, idle = [], [], [], []
    for _ in range(rounds):
        alone.append((await _cpu(seconds, daemon.pid))[0])
        async with gateway_process(daemon.endpoint) as (process, address):
            async with websockets.connect(address, subprotocols=[_SUBPROTOCOL], max_size=None):
                idle.append((await _cpu(seconds / 2, process.pid))[0])
            async with Viewer.open(address):
                both = await _cpu(seconds, daemon.pid, process.pid)
                viewed.append(both[0])
                gateway.append(both[1])
    means = {name: 100 * statistics.mean(parts) for name, parts in _named(alone, viewed, gateway, idle)}
    return {name: round(value, 2) for name, value in means.items()} | {
        "daemon_ratio": round(means["daemon_viewed_percent"] / means["daemon_percent"], 3),
        "load": round(os.getloadavg()[0], 1),
    }


def _named(*parts: list[float]) -> zip[tuple[str, list[float]]]:
    names = ("daemon_percent", "daemon_viewed_percent", "gateway_percent", "gateway_idle_percent")
    return zip(names, parts, strict=True)


async def _observed(endpoint: str, seconds: float) -> dict[str, Any]:
    """What `_observe` sees, in a process that does nothing else."""
    async with gateway_process(endpoint) as (_, address):
        command = (sys.executable, "-m", "lab.gateways_foxglove", endpoint, address, str(seconds))
        process = await asyncio.create_subprocess_exec(*command, stdin=DEVNULL, stdout=PIPE)
        said, _ = await process.communicate()
    found: dict[str, Any] = json.loads(said)
    return found


async def _observe(endpoint: str, address: str, seconds: float) -> dict[str, Any]:
    """From the bus's arrival here to a viewer's, for every value that is shown as JSON."""
    arrived: list[tuple[str, bytes, float]] = []

    def on_sample(sample: zenoh.Sample) -> None:
        arrived.append((str(sample.key_expr), sample.payload.to_bytes(), time.monotonic()))

    handler = zenoh.handlers.Callback(on_sample, indirect=False)
    async with connected(endpoint) as observer, Viewer.open(address) as viewer:
        await asyncio.sleep(SETTLING)
        with observer.session.declare_subscriber(f"mk/{VEHICLE}/**", handler), Sleeper() as sleeper:
            began = len(viewer.seen)
            await asyncio.sleep(seconds)
            count = len(viewer.seen) - began
        await asyncio.sleep(1.0)  # for what is under way
    shown = {(topic, log_time): at for topic, log_time, at in viewer.seen}
    head, added = f"mk/{VEHICLE}", []
    for key, payload, at in arrived:
        with suppress(ValueError, KeyError, TypeError):
            wall = nanoseconds(msgpack.unpackb(payload)["stamp"]["wall"])
            added.append(1e3 * (shown[key.removeprefix(head), wall] - at))
    return {
        "added_p50_ms": round(_share(added, 0.5), 2),
        "added_p99_ms": round(_share(added, 0.99), 2),
        "woken_p99_ms": sleeper.percentile(99),
        "values_compared": len(added),
        "messages_per_s": round(count / seconds),
    }


async def _steer(uav: Vehicle) -> None:
    """Stream neutral sticks for ever; begin again where a busy machine lost the lease."""
    while True:
        with suppress(MkError):
            async with uav.lease(force=True) as lease:
                while True:
                    await lease.stick(pitch=0, roll=0, throttle=-50, seconds=10.0)
        await asyncio.sleep(0.2)


async def _cpu(seconds: float, *processes: int) -> list[float]:
    """Processor time that processes use a second, when things have settled."""
    await asyncio.sleep(SETTLING)
    began, used = time.monotonic(), [cpu_of(process) for process in processes]
    await asyncio.sleep(seconds)
    took = time.monotonic() - began
    return [(cpu_of(process) - before) / took for process, before in zip(processes, used, strict=True)]


def _share(values: Sequence[float], share: float) -> float:
    """The value below which that share of all lies."""
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]


_SUBPROTOCOL: Final = websockets.Subprotocol("foxglove.sdk.v1")


class Viewer:
    """A viewer of every channel.

    Attributes:
        seen: topic, log time [ns] and arrival [s; monotonic] of every message.
    """

    def __init__(self, socket: websockets.ClientConnection) -> None:
        self.seen: list[tuple[str, int, float]] = []
        self._socket = socket
        self._topics: dict[int, str] = {}

    @classmethod
    @asynccontextmanager
    async def open(cls, address: str) -> AsyncIterator[Viewer]:
        """Look at everything while the context lasts."""
        async with websockets.connect(address, subprotocols=[_SUBPROTOCOL], max_size=None) as socket:
            viewer = cls(socket)
            reading = asyncio.create_task(viewer._read(), name="viewer")
            try:
                yield viewer
            finally:
                reading.cancel()
                await asyncio.gather(reading, return_exceptions=True)

    async def _read(self) -> None:
        async for message in self._socket:
            if isinstance(message, bytes):
                if message[0] == MESSAGE:
                    number, log_time = struct.unpack_from("<IQ", message, 1)
                    self.seen.append((self._topics[number], log_time, time.monotonic()))
                continue
            said = json.loads(message)
            if said["op"] == "advertise":
                self._topics |= {channel["id"]: channel["topic"] for channel in said["channels"]}
                asked = [{"id": channel["id"], "channelId": channel["id"]} for channel in said["channels"]]
                await self._socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))


@asynccontextmanager
async def gateway_process(endpoint: str) -> AsyncIterator[tuple[Process, str]]:
    """`mkdaemon gateway foxglove` as a process, and where viewers connect to."""
    options = ("--vehicle", VEHICLE, "--connect", endpoint, "--port", "0", "--json")
    command = (sys.executable, *PROGRAM, "gateway", "foxglove", *options)
    process = await asyncio.create_subprocess_exec(*command, stdin=DEVNULL, stdout=PIPE)
    try:
        assert process.stdout is not None
        async with asyncio.timeout(START):
            line = await process.stdout.readline()
        yield process, json.loads(line)["address"]
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()


if __name__ == "__main__":
    print(json.dumps(asyncio.run(_observe(sys.argv[1], sys.argv[2], float(sys.argv[3])))))
