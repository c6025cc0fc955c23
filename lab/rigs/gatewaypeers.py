"""The other side of each gateway, asking for everything at full rate, and noting when attitudes come through."""

from __future__ import annotations

import asyncio
import json
import os
import struct
import threading
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

from mkdaemon.record.entry import nanoseconds
from mkdaemon.stamp import Stamp

WHOLE_BOOT: Final = 1 << 32
"""`time_boot_ms` begins again after so many."""
MESSAGE: Final = 1
"""First byte of Foxglove's message with data; its channel's subscription and its log time follow."""
SHARPNESS: Final = 10_000
"""A wall time is known again to so many nanoseconds: ROS has its seconds and nanoseconds rounded apart."""


@dataclass(slots=True)
class Arrivals:
    """What came through a gateway.

    Attributes:
        at: for each attitude, when it came [s; monotonic], by what tells which it is.
        count: messages of every kind.
    """

    at: dict[int, float] = field(default_factory=dict)
    count: int = 0


@dataclass(frozen=True, slots=True)
class Peer:
    """Who looks through a gateway.

    Attributes:
        options: of the gateway's command, by a port that is free.
        open: connects to the gateway at that port of this machine, while the context lasts.
        number: tells which attitude one is, by its stamp.
    """

    options: Callable[[int], Sequence[str]]
    open: Callable[[int], AbstractAsyncContextManager[Arrivals]]
    number: Callable[[Stamp], int]


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
            send(mavlink.MAVLink_command_long_message(1, 1, 511, 0, number, 2000, *[0] * 5))  # the fastest: 2 ms
        yield arrivals
    finally:
        beating.cancel()
        transport.close()


@asynccontextmanager
async def _viewer(port: int) -> AsyncIterator[Arrivals]:
    """A viewer of every channel of the Foxglove gateway."""
    import websockets

    arrivals, topics = Arrivals(), dict[int, str]()

    async def read(socket: websockets.ClientConnection) -> None:
        async for message in socket:
            if isinstance(message, bytes):
                if message[0] == MESSAGE:
                    number, log_time = struct.unpack_from("<IQ", message, 1)
                    arrivals.count += 1
                    if topics[number] == "/state/attitude":
                        arrivals.at[log_time // SHARPNESS] = time.monotonic()
                continue
            said = json.loads(message)
            if said["op"] == "advertise":
                topics.update((channel["id"], channel["topic"]) for channel in said["channels"])
                asked = [{"id": channel["id"], "channelId": channel["id"]} for channel in said["channels"]]
                await socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    protocol = websockets.Subprotocol("foxglove.sdk.v1")
    async with websockets.connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol], max_size=None) as socket:
        reading = asyncio.create_task(read(socket), name="viewer")
        try:
            yield arrivals
        finally:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)


@asynccontextmanager
async def _node(port: int) -> AsyncIterator[Arrivals]:
    """A node of rclpy, on a thread of its own, that subscribes to every topic whose type is installed."""
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.qos import qos_profile_sensor_data

    from lab.rigs.overtarget import VEHICLE
    from mkdaemon.gateways.ros2.rclnode import type_of
    from mkdaemon.gateways.ros2.topics import TOPICS

    arrivals, context = Arrivals(), rclpy.Context()
    rclpy.init(context=context)
    node, executor = Node("watcher", context=context), SingleThreadedExecutor(context=context)

    def arrived(name: str, message: Any) -> None:
        arrivals.count += 1
        if name == "imu":
            stamp = message.header.stamp
            arrivals.at[(stamp.sec * 1_000_000_000 + stamp.nanosec) // SHARPNESS] = time.monotonic()

    for name, kind in {(row.name, row.type) for row in TOPICS}:
        if type_of(kind) is not None:
            topic = name.format(camera="down")
            where = topic if topic.startswith("/") else f"/{VEHICLE}/{topic}"
            node.create_subscription(type_of(kind), where, partial(arrived, name), qos_profile_sensor_data)
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin, name="watcher", daemon=True)
    thread.start()
    try:
        yield arrivals
    finally:
        await asyncio.to_thread(executor.shutdown, 2.0)
        thread.join(5.0)
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def _boot_ms(stamp: Stamp) -> int:
    return int(stamp.monotonic * 1000) % WHOLE_BOOT


def _wall(stamp: Stamp) -> int:
    return nanoseconds(stamp.wall) // SHARPNESS


PEERS: Final = {
    "mavlink": Peer(lambda port: ("--link", f"udpin:127.0.0.1:{port}"), _ground_station, _boot_ms),
    "foxglove": Peer(lambda port: ("--port", str(port)), _viewer, _wall),
    "ros2": Peer(lambda port: (), _node, _wall),
}
"""The gateways that can be measured; a further one is one line here and its peer."""


def own_domain() -> None:
    """Keep ROS 2 to this machine, and to a domain of this process and its children, unless the environment says."""
    os.environ.setdefault("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
