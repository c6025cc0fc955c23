"""The gateway before real rclpy, and a daemon without boards: every topic, every service, what flies, and a bag."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from itertools import groupby

import pytest

pytest.importorskip("rclpy", reason="`make check-gateways` installs it")

from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from lab.rigs.waiting import wait_for
from mkdaemon.clock import Clock
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.path.stored import StoredPaths
from mkdaemon.gateways.ros2.parameters import PARAMETERS
from mkdaemon.gateways.ros2.rclnode import RosNode, type_of
from mkdaemon.gateways.ros2.services import SERVICES
from mkdaemon.gateways.ros2.topics import DIAGNOSTICS
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.path import PathUploadRequest
from tests import samples
from tests.client.fake import VEHICLE, fake_daemon
from tests.gateways.ros2.bagtypes import store
from tests.gateways.ros2.rosworld import (
    PATIENCE,
    domain,
    gateway,
    gateway_words,
    joy,
    listen_to_all,
    stream_until,
    topic_names,
    tutorial,
)

pytestmark = [
    pytest.mark.gateways,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of what rclpy imports
]

CHOSEN = ("--", "--ros-args", "-p", "topics:=[imu]")


def publish_all(daemon):
    """Every value of the aircraft, measured now."""
    clock = Clock()
    for suffix, value in samples.EVERY:
        daemon.bus.publish(suffix, value.model_copy(update={"stamp": clock.stamp()}))


async def test_a_node_as_in_a_tutorial_receives_every_topic_and_rosbags_reads_a_bag_of_them(tmp_path):
    with domain(), tutorial() as node:
        async with fake_daemon() as daemon, gateway(daemon.endpoint, VEHICLE):
            listen_to_all(node, VEHICLE)
            expected = {*topic_names(VEHICLE), DIAGNOSTICS}
            for _ in range(100):
                publish_all(daemon)
                await asyncio.sleep(0.2)
                if all(node.messages[name] for name in expected):
                    break
            assert {name for name in expected if not node.messages[name]} == set()
            await measured_and_not_arrival(daemon, node)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        into = {name: writer.add_connection(name, kind, typestore=store()) for name, kind in node.types.items()}
        for name, at, content in list(node.recorded):
            writer.write(into[name], at, content)
    with Reader(tmp_path / "bag") as reader:
        read = [(c.topic, store().deserialize_cdr(content, c.msgtype)) for c, _, content in reader.messages()]
    assert len(read) == len(node.recorded)
    assert {name for name, _ in read} == expected
    turned = next(message for name, message in read if name == f"/{VEHICLE}/imu").orientation
    assert (turned.z, turned.w) == pytest.approx((0.479425538604203, 0.8775825618903728))


async def test_reliable_and_best_effort_subscribers_both_receive():
    name, kind = f"/{VEHICLE}/imu", "sensor_msgs/msg/Imu"
    with domain(), tutorial() as reliable, tutorial() as best_effort:
        async with fake_daemon() as daemon, gateway(daemon.endpoint, VEHICLE, *CHOSEN):
            reliable.listen(name, kind, 10)  # a number is the tutorial's way, and reliable
            best_effort.listen(name, kind)

            def both():
                daemon.bus.publish("state/attitude", samples.attitude())
                return reliable.messages[name] and best_effort.messages[name]

            await wait_for(both, 60.0, 0.05)


async def test_a_topic_can_have_the_name_that_mavros_gives_it():
    with domain(), tutorial() as node:
        async with fake_daemon() as daemon, gateway(daemon.endpoint, VEHICLE, *CHOSEN, "-r", "imu:=imu/data"):
            node.listen(f"/{VEHICLE}/imu/data", "sensor_msgs/msg/Imu", 10)

            def received():
                daemon.bus.publish("state/attitude", samples.attitude())
                return node.messages[f"/{VEHICLE}/imu/data"]

            await wait_for(received, 60.0, 0.05)


async def test_cmd_vel_as_nav2_publishes_it_is_reported_or_flies():
    def stamped():
        message = type_of("geometry_msgs/msg/TwistStamped")()
        message.header.frame_id = "base_link"
        message.twist.linear.x = 0.25
        return message

    with domain(), tutorial() as node:
        publisher = node.say(f"/{VEHICLE}/cmd_vel", "geometry_msgs/msg/TwistStamped")
        async with fake_daemon() as daemon:
            node.listen(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray")
            async with gateway(daemon.endpoint, VEHICLE):
                await stream_until(publisher, stamped, lambda: "cmd_vel.stamped:=true" in gateway_words(node))
                assert daemon.setpoints == []
            async with gateway(daemon.endpoint, VEHICLE, "--", "--ros-args", "-p", "cmd_vel.stamped:=true"):
                await stream_until(publisher, stamped, lambda: any("velocity" in f for f in daemon.setpoints))


async def measured_and_not_arrival(daemon, node):
    """A value that was measured long ago keeps its time."""
    name = f"/{VEHICLE}/imu"
    daemon.bus.publish("state/attitude", samples.attitude())
    measured = (1_700_000_100, 500_000_000)
    await wait_for(lambda: any((m.header.stamp.sec, m.header.stamp.nanosec) == measured for m in node.messages[name]))


async def test_every_service_answers():
    with domain(), tutorial() as node:
        async with fake_daemon() as daemon, gateway(daemon.endpoint, VEHICLE):
            daemon.replies["do/abort"] = dict
            daemon.replies["do/mark"] = dict
            answers = {
                service.name: await node.call(f"/{VEHICLE}/{service.name}", service.type)
                for service in SERVICES
                if service.name not in {"take_off", "land"} and type_of(service.type) is not None
            }
            for name in ("hold", "release", "abort", "mark", "preflight"):
                assert answers[name].success, (name, answers[name].message)
            assert answers["self_test"].passed == b"\x01"
            for name in ("stop", "route_start", "route_end", "param/pull", "cancel"):
                assert not answers[name].success
                assert ":" in answers[name].message, "token, reason and remedy"
            landing = asyncio.create_task(node.call(f"/{VEHICLE}/land", "std_srvs/srv/Trigger"))
            await wait_for(lambda: any("yaw" in fields and "height" not in fields for fields in daemon.setpoints))
            assert (await node.call(f"/{VEHICLE}/release", "std_srvs/srv/Trigger")).success
            assert "land was interrupted" in (await landing).message


async def test_joy_and_cmd_vel_fly_and_a_publisher_that_falls_silent_ends_it():
    with domain(), tutorial() as node:
        async with fake_daemon() as daemon, gateway(daemon.endpoint, VEHICLE):
            pad = node.say(f"/{VEHICLE}/joy", "sensor_msgs/msg/Joy")
            await wait_for(pad.get_subscription_count)
            node.listen(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray")
            await stream_until(pad, lambda: joy(node, {"ABS_Y": 1.0}), lambda: "hold BTN_TL" in gateway_words(node))
            assert daemon.holder is None, "nothing without the enable button"
            await stream_until(
                pad,
                lambda: joy(node, {"ABS_RX": 1.0}, ("BTN_TL",)),
                lambda: any(fields.get("roll") == 30.0 for fields in daemon.setpoints),
            )
            await wait_for(lambda: daemon.holder is None)
            assert daemon.setpoints[-1]["roll"] == 0.0
            twist = type_of("geometry_msgs/msg/TwistStamped")()
            twist.header.frame_id = "target/pad"
            twist.twist.linear.x = 0.25
            velocity = node.say(f"/{VEHICLE}/cmd_vel_stamped", "geometry_msgs/msg/TwistStamped")
            await wait_for(velocity.get_subscription_count)
            await stream_until(velocity, lambda: twist, lambda: "velocity" in daemon.setpoints[-1])
            newest = daemon.setpoints[-1]
            assert (list(newest["velocity"]), newest["frame"]) == ([0.25, 0.0, 0.0], "pad")
            await wait_for(lambda: daemon.holder is None)


async def test_a_mistake_in_the_arguments_is_one_line():
    with domain():
        async with fake_daemon() as daemon:
            for arguments, words in (
                (("-p", "hold.seconds:=soon"), "hold.seconds"),
                (("-p", "topics:=[imus]"), "topics does not know imus"),
                (("-r", "this is no rule"), "ROS does not take this"),
            ):
                with pytest.raises(TimeoutError, match=words) as failed:
                    async with gateway(daemon.endpoint, VEHICLE, "--", "--ros-args", *arguments):
                        pytest.fail("it started")
                assert "Traceback" not in str(failed.value)


def answered(client, parameter):
    """The answer to a client that sets a parameter.

    It asks again: the node may know of a client's requests before it knows where its answers go, and what it says
    then is lost.
    """
    for _ in range(6):
        future = client.set_parameters([parameter])
        with suppress(TimeoutError):
            asyncio.run(wait_for(future.done, PATIENCE / 6, 0.02))
            return future.result()
    raise TimeoutError(parameter.name)


def test_a_setting_that_was_read_is_a_parameter_that_a_client_writes():
    with domain(), tutorial() as other:
        asked = []

        def ask(name, value):
            asked.append((name, value))
            return "" if value == 81 else "refused: Land first."

        node = RosNode("/mk1", ())
        try:
            node.parameters(PARAMETERS, lambda *_: None, ask)
            for value in (80, 79):  # read twice: the second one is no write
                node.declare("settings.gyro_p", value, "gyro gain")
            node.declare("settings.channels", [1, 2], "channels")
            node.start()
            client = AsyncParameterClient(other, "/mk1/mkdaemon")
            assert client.wait_for_services(PATIENCE)
            found = []
            for value in (81, 99):
                (result,) = answered(client, Parameter("settings.gyro_p", value=value)).results
                found.append((result.successful, result.reason))
            assert found == [(True, ""), (False, "refused: Land first.")]
            assert [each for each, _ in groupby(asked)] == [("settings.gyro_p", 81), ("settings.gyro_p", 99)]
        finally:
            node.close()


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
