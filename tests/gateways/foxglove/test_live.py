"""The gateway as a process of its own, before a whole daemon and before `mkctl log play`, read by a viewer."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
from asyncio.subprocess import DEVNULL, PIPE
from collections import Counter
from contextlib import asynccontextmanager, suppress

import pytest

from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.live import VEHICLE, live_daemon
from lab.rigs.processes import START
from lab.rigs.waiting import wait_for_blocking, wait_until
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.reader import Recording
from mkdaemon.record.view import json_value
from mkdaemon.stamp import nanoseconds
from tests.bus.support import free_endpoint
from tests.gateways.foxglove.viewer import viewing
from tests.places import DATA

pytestmark = [pytest.mark.gateways, pytest.mark.flight, pytest.mark.real_time(tolerance=0.1)]

TARGET = DATA / "recordings" / "fc_over_target.mcap"


@asynccontextmanager
async def program(*words):
    """A program as long as the context lasts."""
    process = await asyncio.create_subprocess_exec(sys.executable, *words, stdin=DEVNULL, stdout=PIPE)
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            process.terminate()
        assert await process.wait() == 0


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


async def test_a_recording_that_mkctl_plays_is_shown_value_by_value():
    endpoint = free_endpoint()
    wanted = Counter(
        entry.key.split("/", 2)[2] for entry in Recording(TARGET).entries(lambda facts: facts.kind is EntryKind.SAMPLE)
    )
    play = (
        "-m",
        "mkdaemon.cli.mkctl.app",
        "log",
        "play",
        str(TARGET),
        "--listen",
        endpoint,
        "--as",
        "show",
        "--speed",
        "4",
    )
    async with program(*play, "--wait", "120", "--json") as player:
        await wait_for_blocking(lambda: _answers(endpoint), START)
        async with gateway("show", endpoint) as shown_at, viewing(shown_at.where) as viewer:
            await viewer.subscribe("/state/attitude", "/control/estimate", "/scene", "/tf")
            result = json.loads(await player.stdout.readline())
            assert result["missing"] == {}
            for suffix in ("state/attitude", "control/estimate"):
                await wait_until(lambda suffix=suffix: len(viewer.of(f"/{suffix}")) >= wanted[suffix])
                assert len(viewer.of(f"/{suffix}")) == wanted[suffix]
            names = {entity["id"] for update in viewer.of("/scene") for entity in update["entities"]}
            assert {"vehicle", "path", "ellipse", "goal"} <= names
        # It ends by itself: a signal in its last moments would kill it.
        await player.wait()


def _answers(endpoint):
    """Whether somebody listens at a TCP endpoint."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except OSError:
        return False
    return True
