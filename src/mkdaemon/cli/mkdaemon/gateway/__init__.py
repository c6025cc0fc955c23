"""`mkdaemon gateway`: MAVLink, ROS 2, Foxglove, motion capture for a MikroKopter, each in a separate process."""

from __future__ import annotations

from typing import Final

from cyclopts import App

from mkdaemon.cli.listing import CommandEntry

GATEWAYS: Final[tuple[CommandEntry, ...]] = (
    CommandEntry("foxglove", "mkdaemon.cli.mkdaemon.gateway.foxglove:foxglove", "Foxglove and Lichtblick look at it."),
    CommandEntry("ros2", "mkdaemon.cli.mkdaemon.gateway.ros2:ros2", "Topics, services and setpoints for ROS 2."),
    CommandEntry(
        "mavlink",
        "mkdaemon.cli.mkdaemon.gateway.mavlink:mavlink",
        "MAVLink 2: QGroundControl, MAVSDK, MAVProxy.",
    ),
    CommandEntry("mocap", "mkdaemon.cli.mkdaemon.gateway.mocap:mocap", "Motion capture reports where vehicles are."),
)
"""Every gateway; a further one is one line here and its module."""

app = App(
    name="gateway",
    help="""A gateway to another system: a separate process, and a client of the daemon like any other.

    It takes the lease only while a program flies through it, and loses it as any client does.""",
)
for _entry in GATEWAYS:
    app.command(_entry.target, name=_entry.name, help=_entry.help)
