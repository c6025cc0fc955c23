"""`mkdaemon gateway ros2`: the vehicle in ROS 2."""

from __future__ import annotations

import asyncio
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.interrupts import run_until_asked_to_end
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkdaemon.gateway.greeting import announce_serving
from mkdaemon.cli.mkdaemon.logs import Level, configure
from mkdaemon.cli.promptness import fast_loop, favour_threads
from mkdaemon.errors import ConfigError


def ros2(
    *ros_arguments: Annotated[str, Parameter(allow_leading_hyphen=True)],
    namespace: str | None = None,
    log: Level = "info",
    connection: Connection = HERE,
) -> None:
    """Show the vehicle in ROS 2: values as topics, verbs as services, `joy`, `cmd_vel` and `setpoint_pose` fly.

    docs/ros.md lists topics, services and parameters; parameters of the node come behind `--`. It stays on this machine
    unless ROS_AUTOMATIC_DISCOVERY_RANGE says else. Needs rclpy: the user's own ROS 2 (source its setup file), or
    pip install 'mkdaemon[ros2]'.

    Example: mkdaemon gateway ros2 -- --ros-args -p rates.imu:=10.0

    Args:
        ros_arguments: Arguments of ROS, behind `--`.
        namespace: Of its topics and services; the vehicle's name unless given, `-` as `_`.
        log: Least severity written to stderr.

    Raises:
        ConfigError: rclpy is not installed, or ROS does not take the arguments.
        MkError: no daemon or player at the endpoint.
    """
    configure(log)
    try:
        import rclpy  # noqa: F401
        import sensor_msgs.msg  # noqa: F401
    except ImportError as error:
        raise ConfigError(
            f"mkdaemon gateway ros2 needs rclpy ({error}): source the setup file of your ROS 2 and start it with its "
            "Python, or pip install 'mkdaemon[ros2]' (docs/ros.md)"
        ) from None
    from mkdaemon.gateways.ros2.gateway import run

    def serving(where: str) -> None:
        favour_threads()
        announce_serving("ros2", (connection.vehicle,), where, as_json=connection.json)

    async def serve() -> None:
        async with connection.open() as uav:
            await run(uav, ros_arguments, namespace, serving)

    with asyncio.Runner(loop_factory=fast_loop()) as runner:
        runner.run(run_until_asked_to_end(serve()))
