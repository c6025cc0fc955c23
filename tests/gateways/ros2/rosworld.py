"""The other side of the gateway, with rclpy as in its tutorials: nodes that listen, publish and call."""

from __future__ import annotations

import asyncio
import os
import random
import threading
import time
from contextlib import contextmanager

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.serialization import serialize_message

from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.waiting import wait_for
from mkdaemon.gateways.ros2.commands import AXES, BUTTONS
from mkdaemon.gateways.ros2.rclnode import type_of
from mkdaemon.gateways.ros2.topics import DIAGNOSTICS, TOPICS, Quality

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PERIOD = 0.05
"""Between two messages that fly [s]."""
PATIENCE = 60.0
"""Longest wait for an answer, or for discovery [s]; a loaded machine is slow, not wrong."""


class Tutorial(Node):
    """Listens to topics, publishes, calls services.

    Attributes:
        messages: everything that came, by topic.
        recorded: the same as (topic, nanoseconds, bytes), in order.
    """

    def __init__(self, context):
        super().__init__("tutorial", context=context)
        self.messages, self.recorded, self.types = {}, [], {}
        self._sending = {}

    def listen(self, name, kind, qos=qos_profile_sensor_data):
        self.messages[name], self.types[name] = [], kind

        def arrived(message):
            self.messages[name].append(message)
            self.recorded.append((name, time.time_ns(), serialize_message(message)))

        self.create_subscription(type_of(kind), name, arrived, qos)

    def newest(self, name):
        return self.messages[name][-1] if self.messages[name] else None

    def say(self, name, kind):
        """A publisher of a topic."""
        return self.create_publisher(type_of(kind), name, 1)

    async def call(self, name, kind, **fields):
        """Call a service as in the tutorial and wait for its answer."""
        cls = type_of(kind)
        client = self.create_client(cls, name)
        assert await asyncio.to_thread(client.wait_for_service, PATIENCE), f"no service {name}"
        future = client.call_async(cls.Request(**fields))
        await wait_for(future.done, PATIENCE * 2, 0.02)
        return future.result()


@contextmanager
def domain():
    """A domain of our own on this machine, for this process and those it starts."""
    before = dict(os.environ)
    os.environ |= {"ROS_DOMAIN_ID": str(random.SystemRandom().randint(100, 200)), "ROS_LOG_DIR": os.environ["HOME"]}
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"  # shared memory of a process that was killed holds others up
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


@contextmanager
def tutorial():
    """A node whose callbacks run beside the test."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node, executor = Tutorial(context), SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def spin():
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    try:
        yield node
    finally:
        executor.shutdown(timeout_sec=2.0)
        thread.join(5.0)
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def gateway(endpoint, vehicle, *arguments):
    """`mkdaemon gateway ros2` as a process of its own, until it says that it has started; ends by SIGTERM."""
    return gateway_process("ros2", endpoint, vehicle, *arguments)


def topic_names(vehicle, camera="down"):
    """Every topic whose type is installed, with type and quality."""
    found = {}
    for row in TOPICS:
        if type_of(row.type) is not None:
            name = row.name.format(camera=camera)
            found[name if name.startswith("/") else f"/{vehicle}/{name}"] = (row.type, row.quality)
    return found


def listen_to_all(node, vehicle):
    for name, (kind, quality) in topic_names(vehicle).items():
        node.listen(name, kind, LATCHED) if quality is Quality.LATCHED else node.listen(name, kind)
    node.listen(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray")


async def stream(publisher, make, seconds):
    """Publish twenty times a second."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        publisher.publish(make())
        await asyncio.sleep(PERIOD)


async def stream_until(publisher, make, condition, patience=60.0):
    """Publish twenty times a second until something is so."""
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, "it never was"
        publisher.publish(make())
        await asyncio.sleep(PERIOD)


def joy(node, axes=None, buttons=()):
    """The state of the pad: axes by the kernel's name as a pad's driver gives them, turned round as joy_node does."""
    message = type_of("sensor_msgs/msg/Joy")()
    message.header.stamp = node.get_clock().now().to_msg()
    message.axes = [-float((axes or {}).get(name, 0.0)) for name in AXES]
    message.buttons = [int(name in buttons) for name in BUTTONS]
    return message


def gateway_words(node):
    """What the gateway last reported of itself in /diagnostics."""
    newest = node.newest(DIAGNOSTICS)
    return "" if newest is None else newest.status[-1].message
