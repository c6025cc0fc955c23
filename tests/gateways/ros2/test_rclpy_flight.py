"""Real rclpy flies the simulated aircraft through the gateway: whole daemon, rendered camera, real time."""

from __future__ import annotations

import asyncio
import math
import signal
import time
from contextlib import suppress

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="`make check-gateways` installs it")

from lab.rigs.overtarget import VEHICLE as FLOWN
from lab.rigs.overtarget import Setting, favour, hovering
from lab.rigs.waiting import wait_for
from mkdaemon.gateways.ros2.rclnode import type_of
from mkdaemon.gateways.ros2.services import SERVICES
from mkdaemon.gateways.ros2.topics import DIAGNOSTICS
from tests.gateways.programs import running
from tests.gateways.ros2.rosworld import (
    domain,
    gateway,
    listen_to_all,
    stream,
    stream_until,
    topic_names,
    tutorial,
)

pytestmark = [
    pytest.mark.gateways,
    pytest.mark.flight,
    pytest.mark.real_time(tolerance=0.1),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of what rclpy imports
]

LEVELLED = 0.6
"""From the last message of a pad to level sticks on the line [s]; docs/ros.md says 0.3."""
RELEASED = 1.1
"""From there to the release [s]; docs/ros.md says 0.9."""


async def test_a_pad_that_is_killed_while_it_flies_is_levelled_and_released_on_the_wire():
    with domain():
        async with (
            hovering(Setting(fps=5.0, wind="none", is_tapped=True)) as hover,
            gateway(hover.endpoint, FLOWN),
            running("-m", "tests.gateways.ros2.padprogram", FLOWN) as pad,
        ):
            favour(hover.daemon.pid)  # what is looked at is the gateway: a busy machine says nothing of it
            await wait_for(lambda: hover.seen.is_flying and hover.seen.last["control/output"]["roll"], 60.0)
            assert pad.returncode is None
            killed = time.monotonic()
            pad.send_signal(signal.SIGKILL)
            await wait_for(lambda: hover.seen.phases[-1].startswith("free"), 10.0, 0.01)
            await asyncio.sleep(0.5)
        after = [(at - killed, frame) for at, frame in hover.tap.sticks() if at > killed]
    levelled = [at for at, frame in after if frame.config and frame.roll == 0]
    released = [at for at, frame in after if not frame.config]
    assert levelled and levelled[0] < LEVELLED
    assert released and released[0] <= RELEASED
    assert not [at for at, frame in after if frame.config and at > released[0]], "and stays released"


async def test_a_node_as_in_a_tutorial_receives_calls_and_flies():
    with domain(), tutorial() as node:
        async with hovering(Setting(fps=10.0)) as hover, gateway(hover.endpoint, FLOWN):
            listen_to_all(node, FLOWN)
            pilot = f"/{FLOWN}/pilot"  # a NaviCtrl does not tell his sticks
            quiet = {f"/{FLOWN}/{name}" for name in ("odom", "sticks", "events", "raw/tx")} | {pilot}
            expected = set(topic_names(FLOWN)) - quiet | {DIAGNOSTICS}
            await hear_from(node, expected)
            await call_every_service(node, hover)
            await fly_by_velocity(node, hover)
            await hold_and_land(node, hover)
            assert all(node.messages[name] for name in set(topic_names(FLOWN)) - {f"/{FLOWN}/events", pilot})


async def hear_from(node, names):
    def silent():
        return sorted(name for name in names if not node.messages[name])

    with suppress(TimeoutError):
        await wait_for(lambda: not silent(), 60.0, 0.1)
    assert silent() == []


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
    """Forward at 0.2 m/s for a while, and back; the topic falls silent, and the aircraft is released in time.

    The pilot hovers where it is released: half a metre ahead is too far from the middle for a hold to begin.
    """
    twist = type_of("geometry_msgs/msg/Twist")()
    twist.linear.x = 0.2
    publisher = node.say(f"/{FLOWN}/cmd_vel", "geometry_msgs/msg/Twist")
    await stream_until(publisher, lambda: twist, lambda: hover.seen.is_flying)
    start = np.array(hover.seen.truths[-1][1] if hover.seen.truths else hover.seen.last["sim/truth"]["position_enu"])
    yaw = (await hover.client.state.attitude.latest()).value.yaw
    await stream(publisher, lambda: twist, 2.5)
    moved = np.array(hover.seen.truths[-1][1]) - start
    twist.linear.x = -0.2
    await stream(publisher, lambda: twist, 2.5)
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
