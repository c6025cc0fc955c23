"""The whole gateway without rclpy: values of a bus to publishers, messages and calls to the daemon."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest

from lab.rigs.waiting import wait_for
from mkdaemon.bus.codec import encoding_of
from mkdaemon.client import Sample
from mkdaemon.gateways.ros2.gateway import MOST_CALLS, Ros2Gateway
from mkdaemon.gateways.ros2.messages import pose, vector
from mkdaemon.gateways.ros2.parameters import RATES
from mkdaemon.gateways.ros2.topics import Quality
from mkdaemon.telemetry.state import Attitude
from tests import samples
from tests.client.fake import connected
from tests.gateways.ros2.bagtypes import BagTypes, Node

TYPES = BagTypes()


@asynccontextmanager
async def running(node, before=lambda daemon: None):
    """A gateway before a daemon without boards."""
    async with connected() as (daemon, uav):
        before(daemon)
        gateway = Ros2Gateway(uav, node, TYPES)
        task = asyncio.create_task(gateway.run())
        try:
            await asyncio.sleep(0.2)
            yield SimpleNamespace(daemon=daemon, gateway=gateway, task=task)
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


def reported(node, key):
    """What the gateway has reported of itself under a key."""
    reports = (one for message in node.sent("/diagnostics") for one in message.status if one.name.endswith("gateway"))
    return [value.value for one in reports for value in one.values if value.key == key]


async def called(node, name):
    """Call a service as rclpy does, from a thread."""
    return await asyncio.to_thread(node.services[name], SimpleNamespace(data=False))


async def test_values_become_messages_and_last_values_go_only_to_who_gets_them_late_anyway():
    node = Node()

    def before(daemon):
        daemon.bus.publish("tf", samples.edge())
        daemon.bus.publish("state/attitude", samples.attitude())

    async with running(node, before) as run:
        await wait_for(lambda: node.sent("/tf_static"))
        assert node.sent("imu") == [], "an old value is not published as a new one"
        publish = run.daemon.bus.publish

        def follows():  # last values are asked for first: what is put before is a last value, and comes once more
            publish("state/battery", samples.battery())
            return node.sent("battery_state")

        await wait_for(follows)
        for key, value in samples.keyed(samples.position(), samples.setup(), samples.image(), samples.tags()):
            publish(key, value)
        await wait_for(lambda: node.sent("down/tag_markers"))
        assert len(node.sent("fix")) == len(node.sent("/tf")) == len(node.sent("down/image")) == 1
        assert len(node.sent("down/camera_info")) == 2
        assert len(node.sent("down/tag_markers")) == 1
        assert run.gateway.publishing.missing == {"apriltag_msgs/msg/AprilTagDetectionArray"}
        await wait_for(lambda: any("apriltag_msgs" in words for words in reported(node, "not_installed")))
        assert node.publishers["down/camera_info"].quality is Quality.LATCHED


async def test_a_last_value_never_follows_a_newer_one_and_nothing_follows_the_end():
    node = Node()
    async with running(node) as run:
        publishing = run.gateway.publishing
        old, new = (
            Sample("state/attitude", samples.attitude(roll=roll).model_dump(), encoding_of(Attitude))
            for roll in (0.1, 0.2)
        )
        publishing.take(new)
        publishing.take(old, is_last=True)
        assert publishing.newest.values["state/attitude"].roll == 0.2
        assert len(node.sent("imu")) == 1
    publishing.take(old)
    assert len(node.sent("imu")) == 1


async def test_nothing_is_made_that_nobody_reads_and_rates_are_kept_from_the_next_value_on():
    node = Node(topics=["imu", "raw.rx"], **{f"{RATES}imu": 10.0})
    async with running(node) as run:
        node.publishers["raw/rx"].readers = 0
        assert "fix" not in node.publishers
        for n in range(20):
            run.daemon.bus.publish("state/attitude", samples.attitude(samples.AT + n * 0.02))
            run.daemon.bus.publish("raw/rx", samples.raw())
        await wait_for(lambda: len(node.sent("imu")) == 4)
        node.changed("rates.imu", 0.0)
        n = 20  # which value is the next one, the change decides that is taken up meanwhile
        while len(node.sent("imu")) < 14:
            run.daemon.bus.publish("state/attitude", samples.attitude(samples.AT + n * 0.02))
            n += 1
            await asyncio.sleep(0.01)
        assert n < 60, "ten a second would take fifty values more"
        assert node.sent("raw/rx") == []


async def test_what_cannot_be_flown_is_told():
    node = Node()
    header = TYPES.new(
        "std_msgs/msg/Header", stamp=TYPES.new("builtin_interfaces/msg/Time", sec=5, nanosec=0), frame_id=""
    )
    old = TYPES.new("geometry_msgs/msg/PoseStamped", header=header, pose=pose(TYPES, (0, 0, 2), (1, 0, 0, 0)))
    async with running(node) as run:
        node.subscribed["setpoint_pose"](old)
        await wait_for(lambda: "setpoint_pose was" in run.gateway.deck.note)
        of_body = SimpleNamespace(header=SimpleNamespace(frame_id="base_link"), poses=[])
        node.subscribed["path"](of_body)
        await wait_for(lambda: "a path lies in the frame of a target" in run.gateway.deck.note)
        node.subscribed["path"](SimpleNamespace(header=SimpleNamespace(frame_id=""), poses=[]))
        await wait_for(lambda: "path: give points or pieces" in run.gateway.deck.note)
        node.subscribed["joy"](SimpleNamespace(header=header, axes=[0.0], buttons=[]))
        await wait_for(lambda: "another pad?" in run.gateway.deck.note)
        assert run.daemon.holder is None


async def test_services_answer_and_too_many_at_once_are_refused():
    node = Node()
    async with running(node) as run:
        assert (await called(node, "preflight"))["success"]
        assert (await called(node, "release"))["message"].startswith("confirmed: 5 of 5")
        assert not (await called(node, "mark"))["success"]
        run.gateway._calls = set(range(MOST_CALLS))
        assert "under way" in (await called(node, "abort"))["message"]


async def test_a_gateway_that_only_shows_offers_nothing_that_flies():
    node = Node(commands=False)
    async with running(node):
        assert node.subscribed == {}
        assert "take_off" not in node.services
        assert "release" in node.services


async def test_what_waits_for_a_board_is_answered_at_once_when_the_gateway_ends(monkeypatch):
    asked = asyncio.Event()

    async def never(service, desk, request):
        asked.set()
        await asyncio.Event().wait()

    monkeypatch.setattr("mkdaemon.gateways.ros2.gateway.answer", never)
    node = Node()
    async with running(node) as run:
        waiting = asyncio.create_task(called(node, "preflight"))
        await asked.wait()
        run.gateway.end_calls()
        assert (await waiting)["message"] == "the gateway ends"
        assert (await called(node, "preflight"))["message"] == "the gateway ends"


async def test_cmd_vel_of_another_type_is_reported_with_the_remedy():
    node = Node()
    node.typed["cmd_vel"] = ["geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"]
    async with running(node):
        await wait_for(lambda: node.sent("/diagnostics"))
        (gateway,) = (s for s in node.sent("/diagnostics")[-1].status if s.name.endswith("gateway"))
        assert gateway.level == 1
        assert "cmd_vel is published as geometry_msgs/msg/TwistStamped" in gateway.message
        assert "cmd_vel.stamped:=true" in gateway.message


@pytest.mark.parametrize("stamped", [False, True])
async def test_cmd_vel_flies_as_twist_or_as_twist_stamped_and_its_end_gives_the_lease_back(stamped):
    node, kind = Node(**{"cmd_vel.stamped": stamped}), f"geometry_msgs/msg/Twist{'Stamped' * stamped}"
    message = TYPES.new(
        "geometry_msgs/msg/Twist", linear=vector(TYPES, (0.25, 0, 0)), angular=vector(TYPES, (0, 0, 0.1))
    )
    if stamped:
        header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id="target/pad")
        message = TYPES.new(kind, header=header, twist=message)
    async with running(node) as run:
        assert node.kinds["cmd_vel"] == kind

        def flies():
            node.subscribed["cmd_vel"](message)
            return any(fields.get("velocity") == [0.25, 0.0, 0.0] for fields in run.daemon.setpoints)

        await wait_for(flies)
        assert run.daemon.setpoints[-1]["frame"] == ("pad" if stamped else "body")
        await wait_for(lambda: not run.gateway.deck.flown)
        await wait_for(lambda: run.daemon.holder is None)
