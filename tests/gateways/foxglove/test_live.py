"""The gateway as a process of its own, before a whole daemon and before `mkctl log play`, read by a viewer."""

from __future__ import annotations

import pytest

from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.live import VEHICLE, live_daemon
from lab.rigs.waiting import wait_until
from mkdaemon.record.view import json_value
from mkdaemon.stamp import nanoseconds
from tests.gateways.foxglove.viewer import viewing

pytestmark = [pytest.mark.gateways, pytest.mark.flight, pytest.mark.real_time(tolerance=0.1)]


def gateway(vehicle, endpoint):
    return gateway_process("foxglove", endpoint, vehicle, "--port", "0")


LOOKED_AT = ("/state/attitude", "/tf", "/log", "/diagnostics", "/rx/fc/attitude")


async def test_a_live_flight_is_shown_as_it_is_on_the_bus():
    async with (
        live_daemon() as live,
        gateway(VEHICLE, live.endpoint) as shown_at,
        live.client() as uav,
        viewing(shown_at.where) as viewer,
    ):
        await viewer.subscribe(*LOOKED_AT)
        async with uav.lease(holder="me"):
            await viewer.first("/log")
        await viewer.first(*LOOKED_AT)
        await wait_until(lambda: any("me holds the lease" in one["message"] for one in viewer.of("/log")))
        parts = {status["name"] for one in viewer.of("/diagnostics") for status in one["status"]}
        assert {"vehicle", "link", "control"} <= parts
        await wait_until(lambda: len(viewer.of("/state/attitude")) >= 5)
        # What the daemon put, by another client, and what the viewer saw.
        shown = {one.log_time: one.value for one in viewer.seen if one.topic == "/state/attitude"}
        told = {nanoseconds(one["stamp"]["wall"]): json_value(one) for one in live.values("state/attitude")}
        assert {at: told.get(at) for at in shown} == shown
