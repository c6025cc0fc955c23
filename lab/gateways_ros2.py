"""What the ROS 2 gateway costs: latency added to every value, and processor time at full rate.

`python -m lab gateways --case ros2` starts the gateway as a process of its own before a bus that carries what an
aircraft in flight does, and a node of rclpy that subscribes to everything. Latency is from the put on the bus to the
callback of the subscriber: Zenoh, the gateway, DDS and rclpy's own way in, all of it. Needs the extra `ros2`.
"""

from __future__ import annotations

import asyncio
import math
import os
import random
import sys
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any, Final

import numpy as np

from lab.rigs.processes import PROGRAM, cpu_of
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.bus.gateway import Bus
from mkdaemon.clock import Clock
from mkdaemon.config.bus import BusConfig
from mkdaemon.telemetry.control import ControlEstimate, ControlOutput
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.state import Attitude, Battery, Position, Velocity
from mkdaemon.telemetry.traffic import RawFrame

VEHICLE: Final = "measured"
SECONDS: Final = 20.0
"""How long it is measured unless asked for otherwise [s]."""
SETTLING: Final = 5.0
"""Discovery and imports before that [s]."""
START: Final = 60.0
"""Longest start of the gateway [s]."""
RATES: Final = {
    "state/attitude": 50.0,
    "control/output": 50.0,
    "control/estimate": 50.0,
    "state/position": 10.0,
    "state/velocity": 10.0,
    "state/battery": 10.0,
    "raw/rx": 130.0,
    "raw/tx": 60.0,
    "vision/down/image": 2.0,
}
"""Values a second of a full line, a flight at 50 stick frames a second, and images for people [Hz]."""
TOPICS: Final = {
    "imu": "sensor_msgs/msg/Imu",
    "sticks": "sensor_msgs/msg/Joy",
    "odom": "nav_msgs/msg/Odometry",
    "fix": "sensor_msgs/msg/NavSatFix",
    "velocity": "geometry_msgs/msg/TwistStamped",
    "battery_state": "sensor_msgs/msg/BatteryState",
    "raw/rx": "std_msgs/msg/UInt8MultiArray",
    "raw/tx": "std_msgs/msg/UInt8MultiArray",
    "down/image/compressed": "sensor_msgs/msg/CompressedImage",
}
"""What the node subscribes to; the raw frames have no header, and count for the load alone."""


def values() -> dict[str, Any]:
    """One value of every key of `RATES`."""
    stamp = Clock().stamp()
    state = {"stamp": stamp, "source": "nc/osd"}
    zero3 = (0.0, 0.0, 0.0)
    jpeg = random.Random(1).randbytes(20_000)
    return {
        "state/attitude": Attitude(**state, quaternion=(1.0, 0.0, 0.0, 0.0), roll=0.0, pitch=0.0, yaw=0.0),
        "control/output": ControlOutput(
            stamp=stamp, epoch=1, sequence=1, frame=1, age=0.0, pitch=1, roll=1, yaw=0, throttle=0, limited=False
        ),
        "control/estimate": ControlEstimate(
            stamp=stamp,
            target="pad",
            position=(0.0, 0.0, 2.0),
            velocity=zero3,
            tilt=(0.02, 0.01),
            disturbance=(0.0, 0.0),
            yaw=0.5,
            hover_throttle=0.0,
            position_sd=(0.02, 0.02, 0.03),
            covariance=((0.01, 0.0, 0.01),) * 3,
            image_age=0.1,
            innovation=0.5,
            is_nominal=True,
        ),
        "state/position": Position(
            **state,
            latitude_deg=53.0,
            longitude_deg=7.0,
            altitude=10.0,
            altitude_above_start=2.0,
            position_enu=(1.0, 2.0, 2.0),
            home_latitude_deg=53.0,
            home_longitude_deg=7.0,
            home_distance=2.0,
        ),
        "state/velocity": Velocity(**state, velocity_enu=zero3, ground_speed=0.0, course=0.0, climb_rate=0.0),
        "state/battery": Battery(**state, voltage=15.5, current=12.0, used_mah=100.0, is_low=False),
        "raw/rx": RawFrame(stamp=stamp, sequence=1, raw=b"#" + b"=" * 90 + b"\r"),
        "raw/tx": RawFrame(stamp=stamp, sequence=1, raw=b"#" + b"=" * 20 + b"\r", purpose="setpoint"),
        "vision/down/image": CameraFrame(stamp=stamp, camera="down", width=640, height=480, coding="jpeg", pixels=jpeg),
    }


class Arrivals:
    """Latencies of what arrives, by topic [s]."""

    def __init__(self) -> None:
        self.latencies: dict[str, list[float]] = {name: [] for name in TOPICS}
        self.counts = dict.fromkeys(TOPICS, 0)

    def arrived(self, name: str, message: Any) -> None:
        """Take a message."""
        now = time.time()
        self.counts[name] += 1
        if hasattr(message, "header"):
            stamp = message.header.stamp
            self.latencies[name].append(now - stamp.sec - stamp.nanosec * 1e-9)

    def clear(self) -> None:
        """Forget what arrived so far."""
        for found in self.latencies.values():
            found.clear()
        self.counts = dict.fromkeys(TOPICS, 0)


@contextmanager
def subscribed(arrivals: Arrivals) -> Iterator[None]:
    """A node of rclpy that subscribes to everything, on a thread."""
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.qos import qos_profile_sensor_data

    from mkdaemon.gateways.ros2.rclnode import type_of

    context = rclpy.Context()
    rclpy.init(context=context)
    node, executor = Node("watcher", context=context), SingleThreadedExecutor(context=context)
    for name, kind in TOPICS.items():

        def arrived(message: Any, name: str = name) -> None:
            arrivals.arrived(name, message)

        node.create_subscription(type_of(kind), f"/{VEHICLE}/{name}", arrived, qos_profile_sensor_data)
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin, name="watcher", daemon=True)
    thread.start()
    try:
        yield
    finally:
        executor.shutdown(timeout_sec=2.0)
        thread.join(5.0)
        node.destroy_node()
        rclpy.try_shutdown(context=context)


@asynccontextmanager
async def gateway(endpoint: str) -> AsyncIterator[int]:
    """The gateway as a process; number of the process.

    Raises:
        TimeoutError: it did not start.
        RuntimeError: it ended.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, *PROGRAM, "gateway", "ros2", "--connect", endpoint, "--vehicle", VEHICLE),
        stderr=asyncio.subprocess.PIPE,
    )
    assert process.stderr is not None
    try:
        async with asyncio.timeout(START):
            while b'"started"' not in (line := await process.stderr.readline()):
                if not line:
                    raise RuntimeError("the gateway ended: is the extra `ros2` installed?")
        yield process.pid
    finally:
        if process.returncode is None:
            process.terminate()
        await process.communicate()


async def publish(bus: Bus, seconds: float) -> None:
    """Put every value at its rate for some time, stamped as it is put [s]."""
    clock, loop = Clock(), asyncio.get_running_loop()
    samples = values()
    start = loop.time()
    due = {suffix: start + n * 0.003 for n, suffix in enumerate(RATES)}
    while (now := loop.time()) < start + seconds:
        suffix = min(due, key=due.__getitem__)
        await asyncio.sleep(max(due[suffix] - now, 0.0))
        bus.publish(suffix, samples[suffix].model_copy(update={"stamp": clock.stamp()}))
        due[suffix] = max(due[suffix] + 1.0 / RATES[suffix], loop.time())


async def _measure(seconds: float) -> dict[str, Any]:
    arrivals = Arrivals()
    with reserved_endpoint() as endpoint:
        async with Bus.open(BusConfig(listen=(endpoint,)), VEHICLE) as bus:
            bus.announce()
            async with gateway(endpoint) as process:
                with subscribed(arrivals):
                    await publish(bus, SETTLING)
                    arrivals.clear()
                    before, start = cpu_of(process), time.monotonic()
                    await publish(bus, seconds)
                    share = (cpu_of(process) - before) / (time.monotonic() - start)
                    await asyncio.sleep(0.5)
    every = [latency for found in arrivals.latencies.values() for latency in found]
    p50, p99 = np.percentile(every, [50, 99]) * 1000.0 if every else (math.nan, math.nan)
    return {
        "gateway": "ros2",
        "messages": sum(arrivals.counts.values()),
        "rate": sum(arrivals.counts.values()) / seconds,
        "latency_p50_ms": float(p50),
        "latency_p99_ms": float(p99),
        "cpu_share": share,
        "load": os.getloadavg()[0],
        "is_within": float(p99) <= 5.0 and share <= 0.15,
    }


def measure(seconds: float = SECONDS) -> dict[str, Any]:
    """Measure once; returns figures.

    Args:
        seconds: how long [s].

    Raises:
        TimeoutError: the gateway did not start.
        RuntimeError: the gateway ended.
    """
    os.environ.setdefault("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return asyncio.run(_measure(seconds))
