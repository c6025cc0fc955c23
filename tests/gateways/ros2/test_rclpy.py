"""The gateway before real rclpy, on the whole daemon and the simulated aircraft."""

from __future__ import annotations

import asyncio
import math
import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="`make check-gateways` installs it")

from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from lab.rigs.live import VEHICLE, live_daemon
from lab.rigs.overtarget import VEHICLE as FLOWN
from lab.rigs.overtarget import Setting, hovering
from lab.rigs.waiting import wait_for
from mkdaemon.gateways.ros2.commands import AXES, BUTTONS
from mkdaemon.gateways.ros2.rclnode import type_of
from mkdaemon.gateways.ros2.services import SERVICES
from mkdaemon.gateways.ros2.topics import DIAGNOSTICS, TOPICS, Quality
from tests.gateways.ros2.bagtypes import store
from tests.gateways.ros2.rosworld import LATCHED, domain, gateway, tutorial

pytestmark = [
    pytest.mark.gateways,
    pytest.mark.flight,
    pytest.mark.real_time(tolerance=0.1),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of what rclpy imports
]

PERIOD = 0.05
NEVER_HERE = {"events"}
"""Published when something happens."""


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


async def test_a_pad_flies_by_joy_and_a_silent_one_is_levelled_and_released():
    with domain(), tutorial() as node:
        async with live_daemon() as live, gateway(live.endpoint, VEHICLE):
            node.listen(f"/{VEHICLE}/sticks", "sensor_msgs/msg/Joy")
            node.listen(f"/{VEHICLE}/status", "diagnostic_msgs/msg/DiagnosticStatus", LATCHED)
            pad = node.say(f"/{VEHICLE}/joy", "sensor_msgs/msg/Joy")
            await wait_for(lambda: pad.get_subscription_count() and node.newest(f"/{VEHICLE}/status"))
            await stream(pad, lambda: joy(node, {"ABS_Y": 1.0}), 0.5)
            assert live.values("control/status")[-1]["phase"] == "free", "nothing without the enable button"
            await stream_until(
                pad,
                lambda: joy(node, buttons=("BTN_TL",)),
                lambda: live.values("control/status")[-1]["phase"] == "flying",
            )
            await stream_until(
                pad,
                lambda: joy(node, {"ABS_RX": 1.0}, ("BTN_TL",)),
                lambda: live.values("control/output") and live.values("control/output")[-1]["roll"] > 20,
            )
            silent = time.monotonic()
            await wait_for(lambda: live.values("control/output")[-1]["roll"] == 0)
            assert live.values("control/output")[-1]["stamp"]["monotonic"] - silent < 0.5
            await wait_for(lambda: live.values("control/status")[-1]["phase"] == "free")
            assert live.values("control/status")[-1]["stamp"]["monotonic"] - silent < 1.3
            assert max(message.axes[1] for message in node.messages[f"/{VEHICLE}/sticks"]) == pytest.approx(30 / 127)


@pytest.fixture
def bag(tmp_path):
    return tmp_path / "flight"


async def test_a_node_as_in_a_tutorial_receives_calls_and_flies(bag):
    with domain(), tutorial() as node:
        async with hovering(Setting(fps=10.0)) as hover, gateway(hover.endpoint, FLOWN):
            listen_to_all(node, FLOWN)
            quiet = {f"/{FLOWN}/{name}" for name in ("odom", "sticks", "events", "raw/tx")}
            expected = set(topic_names(FLOWN)) - quiet | {DIAGNOSTICS}
            await wait_for(lambda: all(node.messages[name] for name in expected), 60.0, 0.1)
            await call_every_service(node, hover)
            await fly_by_velocity(node, hover)
            await hold_and_land(node, hover)
            assert all(node.messages[name] for name in set(topic_names(FLOWN)) - {f"/{FLOWN}/events"})
    write_bag(node, bag)
    read_bag(node, bag)


async def call_every_service(node, hover):
    """Those that fly are called by what follows."""
    answers = {
        service.name: await node.call(f"/{FLOWN}/{service.name}", service.type)
        for service in SERVICES
        if not service.flies
    }
    assert answers["mark"].success
    assert answers["release"].success
    assert answers["self_test"].id == FLOWN
    assert len(answers["self_test"].status) > 10
    assert answers["preflight"].message
    assert "not_confirmed" in answers["route_start"].message
    assert not answers["route_end"].success
    assert not answers["cancel"].success
    assert "flying_stop" in answers["stop"].message


async def fly_by_velocity(node, hover):
    """Forward at 0.2 m/s for two seconds; the topic falls silent, and the aircraft is released in time."""
    twist = type_of("geometry_msgs/msg/Twist")()
    twist.linear.x = 0.2
    publisher = node.say(f"/{FLOWN}/cmd_vel", "geometry_msgs/msg/Twist")
    await stream_until(publisher, lambda: twist, lambda: hover.seen.is_flying)
    start = np.array(hover.seen.truths[-1][1] if hover.seen.truths else hover.seen.last["sim/truth"]["position_enu"])
    yaw = (await hover.client.state.attitude.latest()).value.yaw
    await stream(publisher, lambda: twist, 2.5)
    moved = np.array(hover.seen.truths[-1][1]) - start
    silent = time.monotonic()
    assert moved[:2] @ [math.cos(yaw), math.sin(yaw)] > 0.2
    await wait_for(lambda: hover.seen.phases[-1].startswith("free"), 10.0)
    assert time.monotonic() - silent < 2.0
    assert any(phase.startswith("stale") for phase in hover.seen.phases)


async def hold_and_land(node, hover):
    """The pilot hovers again; it is held by a verb and lands by another."""
    await wait_for(hover.seen.is_hovering, 60.0, 0.1)
    held = await node.call(f"/{FLOWN}/hold", "std_srvs/srv/Trigger")
    assert held.success, held.message
    assert hover.seen.is_flying
    landed = await node.call(f"/{FLOWN}/land", "std_srvs/srv/Trigger")
    assert landed.success, landed.message


def write_bag(node, path):
    """A bag of everything that was received, as `ros2 bag record` would write it."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {name: writer.add_connection(name, kind, typestore=store()) for name, kind in node.types.items()}
        for name, at, content in node.recorded:
            writer.write(connections[name], at, content)


def read_bag(node, path):
    """Rosbags reads every message, and they are what the node received."""
    counts = dict.fromkeys(node.types, 0)
    with Reader(path) as reader:
        for connection, _, content in reader.messages():
            message = store().deserialize_cdr(content, connection.msgtype)
            if connection.topic == f"/{FLOWN}/imu":
                assert message.header.frame_id == "base_link"
            counts[connection.topic] += 1
    assert counts == {name: len(messages) for name, messages in node.messages.items()}


async def test_a_mistake_in_the_arguments_is_one_line():
    with domain():
        async with live_daemon() as live:
            for arguments, words in (
                (("-p", "hold.seconds:=soon"), "hold.seconds"),
                (("-p", "topics:=[imus]"), "topics does not know imus"),
                (("-r", "this is no rule"), "ROS does not take this"),
            ):
                with pytest.raises(AssertionError, match=words) as failed:
                    async with gateway(live.endpoint, VEHICLE, "--", "--ros-args", *arguments):
                        pytest.fail("it started")
                assert "Traceback" not in str(failed.value)
