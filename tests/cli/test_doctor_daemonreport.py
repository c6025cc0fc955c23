"""What the doctor asks a daemon and a router over a real bus."""

from __future__ import annotations

import asyncio
import json

import pytest
import zenoh

from lab.rigs.processes import connected
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.session import session_config
from mkdaemon.cli.mkdaemon.doctor.daemonreport import NO_DAEMON, ask_daemon
from mkdaemon.config.reader import load
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding, PreflightReport
from mkdaemon.telemetry.status import Status
from mkdaemon.telemetry.vehicle import VehicleHealth
from tests.bus.support import bus_config, free_endpoint
from tests.values import made

LINE = made(LinkState)


def finding(name, token, blocks=Blocks.AUTONOMY):
    state = CheckState.PASSED if token is None else CheckState.STANDS
    return Finding(name=name, state=state, blocks=blocks, token=token, reason=f"{name} is so", fix="mend it")


FOUND = (finding("gate", "gate_constant"), finding("advice", "watch_it", Blocks.NOTHING), finding("disk", None))


@pytest.fixture
async def endpoint():
    """A router that describes itself, and a daemon that is connected to it."""
    where = free_endpoint()
    more = {"adminspace/enabled": True}
    router = await asyncio.to_thread(zenoh.open, session_config("router", listen=[where], more=more))

    async def preflight(suffix, payload):
        report = PreflightReport(is_ready=False, findings=FOUND)
        return CommandResult(status=Status.ACCEPTED, reply=report.model_dump(mode="json"))

    async with Bus.open(bus_config(free_endpoint(), connect=(where,)), "t1") as bus:
        bus.serve("do", preflight)
        bus.publish("health", made(VehicleHealth, is_alive=True))
        bus.publish("link/state", LINE)
        bus.publish("vision/down/stats", LINE)  # of no kind that this release knows
        bus.announce()
        async with connected(where, "t1"):
            pass  # the router has heard of the daemon
        yield where
    await asyncio.to_thread(router.close)


async def test_a_daemon_and_a_router_are_asked(endpoint):
    cfg = load(None, {"vehicle.name": "t1"})
    report = await asyncio.to_thread(ask_daemon, cfg, [endpoint])
    assert (report.failure, report.daemons) == ("", 1)
    assert report.clock is not None
    assert report.line == LINE
    assert report.eyes == ()
    assert report.standing == {"gate_constant": ("gate", "gate is so", "mend it")}
    assert report.routers
    assert all(version.lstrip("v")[0].isdigit() for version in report.routers), json.dumps(report.routers)


async def test_nobody_is_asked_without_the_certificate_that_is_needed(monkeypatch):
    monkeypatch.delenv("MK_ZENOH_FILE", raising=False)
    assert await asyncio.to_thread(ask_daemon, load(None), ["tls/127.0.0.1:1"]) == NO_DAEMON


async def test_nobody_there_is_told_with_the_reason():
    report = await asyncio.to_thread(ask_daemon, load(None), ["tcp/127.0.0.1:1"])
    assert "no program answers at tcp/127.0.0.1:1" in report.failure
    assert report.daemons == 0
