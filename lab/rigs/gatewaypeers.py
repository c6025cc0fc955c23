"""The other side of each gateway, asking for everything at full rate, and noting how late attitudes come; and the bus.

Each is a process of its own, `python -m lab.rigs.gatewaypeers NAME PORT VEHICLE ENDPOINT`, that waits for its gateway,
meets it again when it comes again, and says what came when it gets SIGTERM. It goes before ordinary programs, so it
does not wait for the renderer: that is when a ground station on a computer of its own has a value.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import socket
import struct
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from threading import Thread
from typing import Any, Final

WHOLE_BOOT: Final = 1 << 32
"""`time_boot_ms` begins again after so many."""
MESSAGE: Final = 1
"""First byte of Foxglove's message with data; its channel's subscription and its log time follow."""
ATTITUDE: Final = 30
"""Number of that message of MAVLink; its payload begins with `time_boot_ms`."""
_HEADER: Final = 10
"""Of a frame of MAVLink 2 [bytes]; its payload follows."""
BEAT: Final = 1.0
"""Between two heartbeats of the ground station [s]."""
LOOK: Final = 0.2
"""Between two looks for a gateway that is not there [s]."""
NEW: Final = 2.0
"""A gateway that was silent for so long is another one, and is asked again [s]."""


@dataclass(slots=True)
class Arrivals:
    """What came.

    Attributes:
        late: of each attitude, when it came [s; Unix time] and how long after its stamp [s].
        counts: messages of every kind, by the second in which they came.
    """

    late: list[tuple[float, float]] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)

    def came(self, late: float | None = None) -> None:
        """Note a message; with how late it is [s], where it is an attitude."""
        now = time.time()
        self.counts[int(now)] += 1
        if late is not None:
            self.late.append((now, late))

    @classmethod
    def of(cls, text: str) -> Arrivals:
        """Those that a peer printed."""
        late, counts = json.loads(text)
        return cls([(at, age) for at, age in late], Counter(dict(counts)))


def _client(_: int, vehicle: str, endpoint: str, arrivals: Arrivals) -> None:
    """A client of the bus: what every gateway is as well."""
    import msgpack
    import zenoh

    from mkdaemon.bus.session import session_config

    def on_sample(sample: zenoh.Sample) -> None:
        now = time.time()
        arrivals.came(now - msgpack.unpackb(bytes(sample.payload))["stamp"]["wall"])

    with zenoh.open(session_config("client", connect=[endpoint])) as session:
        session.declare_subscriber(f"mk/{vehicle}/state/attitude", zenoh.handlers.Callback(on_sample, indirect=False))
        time.sleep(3600.0)


def _ground_station(port: int, _: str, __: str, arrivals: Arrivals) -> None:
    """A ground station over UDP that asks for every message as often as it can come."""
    from pymavlink.dialects.v20 import all as mavlink

    from mkdaemon.gateways.mavlink.framing import Encoder
    from mkdaemon.gateways.mavlink.telemetry import IDS

    encoder = Encoder(255, None)
    where = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    where.connect(("127.0.0.1", port))
    where.settimeout(LOOK)
    beaten = heard = 0.0
    while True:
        now = time.monotonic()
        with suppress(OSError):  # silence, or no gateway
            if now - beaten >= BEAT:
                beaten = now
                where.send(encoder.encode(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), 0.0))
            data = where.recv(1 << 16)
            arrivals.came(_late_of(data, time.monotonic()))
            if now - heard > NEW:
                for number in IDS:  # the fastest: 2 ms
                    asked = mavlink.MAVLink_command_long_message(1, 1, 511, 0, number, 2000, *[0] * 5)
                    where.send(encoder.encode(asked, 0.0))
            heard = now


def _late_of(frame: bytes, now: float) -> float | None:
    """How late an attitude in a frame of MAVLink 2 is, by its whole milliseconds [s]; None for another message."""
    if int.from_bytes(frame[7:_HEADER], "little") != ATTITUDE:
        return None
    boot = int.from_bytes(frame[_HEADER : _HEADER + min(4, frame[1])], "little")
    return ((1000 * now - boot) % WHOLE_BOOT - 0.5) / 1000


def _viewer(port: int, _: str, __: str, arrivals: Arrivals) -> None:
    """A viewer of every channel of the Foxglove gateway."""
    from websockets.exceptions import WebSocketException
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    while True:
        topics, asked = dict[int, str](), list[dict[str, int]]()
        with (
            suppress(OSError, WebSocketException),
            connect(f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as where,
        ):
            while True:
                try:
                    data = where.recv(timeout=LOOK)
                except TimeoutError:  # asked at once the SDK, which knows its channels later, answers nothing
                    if asked:
                        where.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
                    asked = []
                    continue
                if isinstance(data, bytes):
                    number, log_time = struct.unpack_from("<IQ", data, 1) if data[0] == MESSAGE else (-1, 0)
                    is_attitude = topics.get(number) == "/state/attitude"
                    arrivals.came(time.time() - log_time / 1e9 if is_attitude else None)
                elif (said := json.loads(data))["op"] == "advertise":
                    topics.update((channel["id"], channel["topic"]) for channel in said["channels"])
                    asked += [{"id": channel["id"], "channelId": channel["id"]} for channel in said["channels"]]
        time.sleep(LOOK)


def _node(_: int, vehicle: str, __: str, arrivals: Arrivals) -> None:
    """A node of rclpy that subscribes to every topic whose type is installed.

    Times are those of the thread of Fast DDS that took a message from its socket; rclpy hands it on later.
    """
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.qos import qos_profile_sensor_data

    from mkdaemon.gateways.ros2.rclnode import type_of
    from mkdaemon.gateways.ros2.topics import TOPICS

    context = rclpy.Context()
    rclpy.init(context=context)
    node, executor = Node("watcher", context=context), SingleThreadedExecutor(context=context)

    def arrived(name: str, message: Any, info: Any) -> None:
        stamp = message.header.stamp if name == "imu" else None
        late = None if stamp is None else info["received_timestamp"] / 1e9 - stamp.sec - stamp.nanosec / 1e9
        arrivals.came(late)

    def hearing(name: str) -> Callable[[Any, Any], None]:
        return lambda message, info: arrived(name, message, info)

    for name, kind in {(row.name, row.type) for row in TOPICS}:
        if type_of(kind) is not None:
            topic = name.format(camera="down")
            where = topic if topic.startswith("/") else f"/{vehicle}/{topic}"
            node.create_subscription(type_of(kind), where, hearing(name), qos_profile_sensor_data)
    executor.add_node(node)
    executor.spin()


BUS: Final = "bus"
LOOKS: Final = {BUS: _client, "mavlink": _ground_station, "foxglove": _viewer, "ros2": _node}
"""Looks for ever through the gateway at a port of this machine, or at the bus, by vehicle and endpoint."""


def options_of(gateway: str, port: int) -> tuple[str, ...]:
    """Of a gateway's command, to be found at a port that is free."""
    return {"mavlink": ("--link", f"udpin:127.0.0.1:{port}"), "foxglove": ("--port", str(port))}.get(gateway, ())


def own_domain() -> None:
    """Keep ROS 2 to this machine, and to a domain of this process and its children, unless the environment says.

    By UDP, as from another computer: between processes of one it would take shared memory.
    """
    os.environ.setdefault("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


def main(name: str, port: int, vehicle: str, endpoint: str) -> None:
    """Look until SIGTERM, then print what came."""
    gc.disable()
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    found = Arrivals()
    Thread(target=LOOKS[name], args=(port, vehicle, endpoint, found), daemon=True).start()
    print("ready", flush=True)
    signal.sigwait({signal.SIGTERM})
    print(json.dumps([found.late, list(found.counts.items())]), flush=True)
    os._exit(0)  # the thread still works, and a node of ROS takes seconds to leave


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4])
