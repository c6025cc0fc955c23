"""The only module that touches rclpy: one node with its publishers, subscriptions, services and parameters.

Messages arrive on threads of rclpy's executor; each subscriber hands them to the loop. Publishing needs no thread.
"""

from __future__ import annotations

import array
import os
import threading
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Any, Final

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from mkdaemon.errors import ConfigError
from mkdaemon.gateways.ros2.parameters import NodeParameter
from mkdaemon.gateways.ros2.topics import Quality

NAME: Final = "mkdaemon"
THREADS: Final = 12
"""Of the executor: a service that flies keeps one until it is done."""
NEWEST: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST)
"""Of what flies: no FIFO carries a setpoint."""


@cache
def type_of(kind: str) -> Any:
    """The class of a type, for example `sensor_msgs/msg/Imu`; None where its package is not installed."""
    package, folder, name = kind.split("/")
    try:
        return getattr(import_module(f"{package}.{folder}"), name)
    except ModuleNotFoundError:
        return None


class RosTypes:
    """Messages of rclpy."""

    def new(self, kind: str, **fields: Any) -> Any:
        """Make a message."""
        return type_of(kind)(**fields)

    def octets(self, raw: bytes) -> Any:
        """Make the value of a field `uint8[]`."""
        return array.array("B", raw)

    def octet(self, value: int) -> Any:
        """Make the value of a field `byte`."""
        return bytes([value])


class RosNode:
    """One node; its callbacks run on separate threads until it is closed."""

    def __init__(self, namespace: str, arguments: Sequence[str]) -> None:
        """Join the graph.

        Args:
            namespace: of everything that is not absolute.
            arguments: of ROS, for example `--ros-args -p hold.seconds:=30.0`.

        Raises:
            ConfigError: ROS does not understand the arguments or the namespace.
        """
        try:
            self._context = rclpy.Context()
            rclpy.init(
                args=["mkdaemon", *arguments],
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self._node = Node(NAME, namespace=namespace, context=self._context)
        except (RuntimeError, ValueError, InvalidNamespaceException, rclpy.exceptions.ParameterException) as error:
            raise ConfigError(f"ROS does not take this: {' '.join(str(error).split())}") from error
        except rclpy._rclpy_pybind11.UnknownROSArgsError as error:  # noqa: SLF001
            raise ConfigError(f"ROS does not take this: {' '.join(str(error).split())}") from error
        self._executor = MultiThreadedExecutor(THREADS, context=self._context)
        self._executor.add_node(self._node)
        self._beside = ReentrantCallbackGroup()
        self._declaring = 0
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)

    @property
    def namespace(self) -> str:
        """Where its topics are."""
        return str(self._node.get_namespace())

    def start(self) -> None:
        """Let callbacks run."""
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def close(self) -> None:
        """Leave the graph; callbacks that wait for something must have got it."""
        self._executor.shutdown(timeout_sec=1.0)
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def parameters(
        self, table: Sequence[NodeParameter], changed: Callable[[str, Any], None], asked: Callable[[str, Any], str]
    ) -> dict[str, Any]:
        """Declare parameters and return their values.

        Args:
            table: of them.
            changed: hears of a new value of one that is not fixed, on a thread of rclpy.
            asked: says why a value is refused, empty for not, on a thread of rclpy that may wait.

        Raises:
            ConfigError: a value is of another type than its default.
        """
        from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult

        try:
            for row in table:
                described = ParameterDescriptor(description=row.about, read_only=row.is_fixed)
                self._node.declare_parameter(row.name, row.default, described)
        except rclpy.exceptions.ParameterException as error:
            raise ConfigError(f"ROS does not take this: {error}") from error

        def parameters_changed(news: Sequence[Any]) -> None:
            for parameter in news:
                changed(parameter.name, parameter.value)

        def parameters_asked(news: Sequence[Any]) -> Any:
            is_read = self._declaring == threading.get_ident()  # from the board, and not by a client
            reasons = [] if is_read else [asked(one.name, one.value) for one in news]
            words = "; ".join(filter(None, reasons))
            return SetParametersResult(successful=not words, reason=words)

        self._node.add_on_set_parameters_callback(parameters_asked)
        self._node.add_post_set_parameters_callback(parameters_changed)
        return {row.name: self._node.get_parameter(row.name).value for row in table}

    def declare(self, name: str, value: Any, about: str) -> None:
        """Declare a parameter, or give it a value that was read."""
        from rcl_interfaces.msg import ParameterDescriptor
        from rclpy.parameter import Parameter as RosParameter

        self._declaring = threading.get_ident()
        try:
            if self._node.has_parameter(name):
                self._node.set_parameters([RosParameter(name, value=value)])
            else:
                self._node.declare_parameter(name, value, ParameterDescriptor(description=about), ignore_override=True)
        finally:
            self._declaring = 0

    def publisher(self, name: str, kind: str, quality: Quality) -> Any:
        """Make a publisher; None where the type's package is not installed."""
        found = type_of(kind)
        if found is None:
            return None
        durability = DurabilityPolicy.TRANSIENT_LOCAL if quality.is_latched else DurabilityPolicy.VOLATILE
        profile = QoSProfile(depth=quality.depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability)
        return self._node.create_publisher(found, name, profile)

    def subscribe(self, name: str, kind: str, arrived: Callable[[Any], None]) -> None:
        """Subscribe to the newest message of a topic.

        Args:
            name: of the topic.
            kind: its type.
            arrived: hears of it, on a thread of rclpy.
        """
        self._node.create_subscription(type_of(kind), name, arrived, NEWEST)

    def types_published(self, name: str) -> frozenset[str]:
        """Types of the publishers of a topic, for example `geometry_msgs/msg/TwistStamped`.

        Args:
            name: of the topic, as it was subscribed.
        """
        return frozenset(one.topic_type for one in self._node.get_publishers_info_by_topic(name))

    def serve(self, name: str, kind: str, answer: Callable[[Any], dict[str, Any]]) -> None:
        """Offer a service, where its type is installed; calls of one do not wait for calls of another.

        Args:
            name: of the service.
            kind: its type.
            answer: returns the fields of the response, on a thread of rclpy that may wait.
        """

        def answered(request: Any, response: Any) -> Any:
            for field, value in answer(request).items():
                setattr(response, field, value)
            return response

        found = type_of(kind)
        if found is not None:
            self._node.create_service(found, name, answered, callback_group=self._beside)


def localhost_only() -> None:
    """Stay on this machine unless the environment says where ROS looks for others."""
    if "ROS_LOCALHOST_ONLY" not in os.environ:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
