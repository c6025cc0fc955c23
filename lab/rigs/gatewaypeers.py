"""The other side of each gateway, asking for everything at full rate, and noting when attitudes come through.

Each is a process of its own, `python -m lab.rigs.gatewaypeers NAME PORT VEHICLE`, that waits for its gateway, meets it
again when it comes again, and tells what came when its standard input ends.
"""

from __future__ import annotations

import gc
import json
import os
import socket
import struct
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from lab.rigs.stamped import Arrivals, be_instrument, go_first, go_ordinary, receive, stamp_arrivals

WHOLE_BOOT: Final = 1 << 32
"""`time_boot_ms` begins again after so many."""
MESSAGE: Final = 1
"""First byte of Foxglove's message with data; its channel's subscription and its log time follow."""
SHARPNESS: Final = 10_000
"""A wall time is known again to so many nanoseconds: ROS has its seconds and nanoseconds rounded apart."""
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


@dataclass(frozen=True, slots=True)
class Peer:
    """Who looks through a gateway.

    Attributes:
        options: of the gateway's command, by a port that is free.
        look: looks for ever through the gateway at that port of this machine.
        number: tells which attitude one is, by the daemon's monotonic and wall time of it [s].
    """

    options: Callable[[int], Sequence[str]]
    look: Callable[[int, str, Arrivals], None]
    number: Callable[[float, float], int]


def _ground_station(port: int, _: str, arrivals: Arrivals) -> None:
    """A ground station over UDP that asks for every message as often as it can come."""
    from pymavlink.dialects.v20 import all as mavlink

    from mkdaemon.gateways.mavlink.framing import Encoder
    from mkdaemon.gateways.mavlink.telemetry import IDS

    encoder = Encoder(255, None)
    where = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    where.connect(("127.0.0.1", port))
    where.settimeout(LOOK)
    stamp_arrivals(where)
    beaten = heard = 0.0
    while True:
        now = time.monotonic()
        with suppress(OSError):  # silence, or no gateway
            if now - beaten >= BEAT:
                beaten = now
                where.send(encoder.encode(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), 0.0))
            data, at = receive(where)
            arrivals.came(at, _boot_ms_of(data))
            if now - heard > NEW:
                for number in IDS:  # the fastest: 2 ms
                    asked = mavlink.MAVLink_command_long_message(1, 1, 511, 0, number, 2000, *[0] * 5)
                    where.send(encoder.encode(asked, 0.0))
            heard = now


def _boot_ms_of(frame: bytes) -> int | None:
    """Which attitude a frame of MAVLink 2 is; None for another message."""
    if int.from_bytes(frame[7:_HEADER], "little") != ATTITUDE:
        return None
    return int.from_bytes(frame[_HEADER : _HEADER + min(4, frame[1])], "little")


def _viewer(port: int, _: str, arrivals: Arrivals) -> None:
    """A viewer of every channel of the Foxglove gateway."""
    while True:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port)) as where:
            stamp_arrivals(where)
            _view(where, port, arrivals)
        time.sleep(LOOK)


def _view(where: socket.socket, port: int, arrivals: Arrivals) -> None:
    """View until the gateway ends."""
    import websockets
    from websockets.client import ClientProtocol
    from websockets.frames import Frame, Opcode
    from websockets.uri import parse_uri

    subprotocol = websockets.Subprotocol("foxglove.sdk.v1")
    protocol = ClientProtocol(parse_uri(f"ws://127.0.0.1:{port}"), subprotocols=[subprotocol], max_size=None)
    protocol.send_request(protocol.connect())
    where.settimeout(LOOK)
    topics, asked, advertised = dict[int, str](), list[dict[str, int]](), 0.0
    while True:
        if asked and time.monotonic() - advertised > LOOK:  # at once is too soon for the SDK, which knows it later
            protocol.send_text(json.dumps({"op": "subscribe", "subscriptions": asked}).encode())
            asked = []
        for piece in protocol.data_to_send():
            where.sendall(piece)
        try:
            data, at = receive(where)
        except TimeoutError:
            continue
        if not data:
            return
        protocol.receive_data(data)
        for event in protocol.events_received():
            if not isinstance(event, Frame):
                continue  # it has accepted
            if event.opcode is Opcode.BINARY and event.data[0] == MESSAGE:
                number, log_time = struct.unpack_from("<IQ", event.data, 1)
                is_attitude = topics.get(number) == "/state/attitude"
                arrivals.came(at, round(log_time / SHARPNESS) if is_attitude else None)
            elif event.opcode is Opcode.TEXT and (said := json.loads(bytes(event.data)))["op"] == "advertise":
                topics.update((channel["id"], channel["topic"]) for channel in said["channels"])
                asked += [{"id": channel["id"], "channelId": channel["id"]} for channel in said["channels"]]
                advertised = time.monotonic()


def _node(_: int, vehicle: str, arrivals: Arrivals) -> None:
    """A node of rclpy that subscribes to every topic whose type is installed.

    Times are those of the thread of Fast DDS that took a message from its socket, which go before others; rclpy hands
    it on later, from an ordinary thread.
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
        number = None
        if name == "imu":
            stamp = message.header.stamp
            number = round((stamp.sec * 1_000_000_000 + stamp.nanosec) / SHARPNESS)
        arrivals.came(info["received_timestamp"], number)

    def hearing(name: str) -> Callable[[Any, Any], None]:
        return lambda message, info: arrived(name, message, info)

    for name, kind in {(row.name, row.type) for row in TOPICS}:
        if type_of(kind) is not None:
            topic = name.format(camera="down")
            where = topic if topic.startswith("/") else f"/{vehicle}/{topic}"
            node.create_subscription(type_of(kind), where, hearing(name), qos_profile_sensor_data)
    go_ordinary()
    executor.add_node(node)
    executor.spin()


def _boot_ms(monotonic: float, _: float) -> int:
    return int(monotonic * 1000) % WHOLE_BOOT


def _wall(_: float, wall: float) -> int:
    return round(wall * 1e9 / SHARPNESS)


PEERS: Final = {
    "mavlink": Peer(lambda port: ("--link", f"udpin:127.0.0.1:{port}"), _ground_station, _boot_ms),
    "foxglove": Peer(lambda port: ("--port", str(port)), _viewer, _wall),
    "ros2": Peer(lambda port: (), _node, _wall),
}
"""The gateways that can be measured; a further one is one line here and its peer."""


def own_domain() -> None:
    """Keep ROS 2 to this machine, and to a domain of this process and its children, unless the environment says.

    By UDP, as from another computer: between processes of one it would take shared memory.
    """
    os.environ.setdefault("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


if __name__ == "__main__":
    gc.disable()
    go_first()
    found = Arrivals()
    be_instrument(partial(PEERS[sys.argv[1]].look, int(sys.argv[2]), sys.argv[3], found), found.as_fields)
