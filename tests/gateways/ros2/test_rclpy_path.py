"""Real rclpy publishes a `nav_msgs/Path`: it is uploaded, flown to its end and held by a daemon without boards."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="`make check-gateways` installs it")

from lab.rigs.waiting import wait_for
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.path.stored import StoredPaths
from mkdaemon.gateways.ros2.rclnode import type_of
from mkdaemon.gateways.ros2.topics import DIAGNOSTICS
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.path import PathUploadRequest
from tests.client.fake import VEHICLE, fake_daemon
from tests.gateways.ros2.rosworld import PATIENCE, domain, gateway, gateway_words, tutorial

pytestmark = [
    pytest.mark.gateways,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of what rclpy imports
]


def path(*points):
    """A path in the target's axes, by (seconds, x, y, z)."""
    message = type_of("nav_msgs/msg/Path")()
    message.header.frame_id = "target/pad"
    for seconds, *place in points:
        pose = type_of("geometry_msgs/msg/PoseStamped")()
        pose.header.frame_id, pose.header.stamp.sec = "target/pad", seconds
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = map(float, place)
        message.poses.append(pose)
    return message


async def test_a_path_is_refused_or_uploaded_flown_to_its_end_and_held():
    with domain(), tutorial() as node:
        publisher = node.say(f"/{VEHICLE}/path", "nav_msgs/msg/Path")
        node.listen(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray")
        async with fake_daemon() as daemon, gateway(daemon.endpoint, VEHICLE):
            kept, stored, is_done = StoredPaths(AutopilotConfig()), [], []

            def upload():
                request = PathUploadRequest.model_validate(daemon.asked[-1][1])
                stored.append(kept.upload(request, AircraftModel()))
                return dict(stored[-1])

            def fly():
                kind = "path" if "path" in daemon.setpoints[-1] else "hold"
                daemon.say(Phase.FLYING, "flies", manoeuvre=kind, is_done=bool(is_done))

            daemon.replies["do/path_upload"], daemon.follow = upload, fly
            await wait_for(publisher.get_subscription_count, PATIENCE)
            publisher.publish(path((10, 0, 0, 2), (11, 3, 0, 2)))
            await wait_for(lambda: "Slow the path down by" in gateway_words(node), PATIENCE)
            assert stored == [] and not any("path" in fields for fields in daemon.setpoints)
            publisher.publish(path((10, 0, 0, 2), (14, 1, 0, 2), (18, 1, 1, 2)))
            await wait_for(lambda: any("path" in fields for fields in daemon.setpoints), PATIENCE)
            assert stored[0].times == (0.0, 4.0, 8.0)
            flown = [fields for fields in daemon.setpoints if "path" in fields]
            assert {(fields["path"], fields["run"]) for fields in flown} == {(stored[0].id, 1)}
            is_done.append(True)
            await wait_for(lambda: "path" not in daemon.setpoints[-1], PATIENCE)
            await wait_for(lambda: "at the end of the path" in gateway_words(node), PATIENCE)
