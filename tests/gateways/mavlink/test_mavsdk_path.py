"""MAVSDK flies a mission in a local frame before a daemon without boards: `make check-gateways`."""

from __future__ import annotations

import asyncio
import json
from itertools import groupby

import pytest

pytest.importorskip("mavsdk", reason="`make check-gateways` installs it")

from lab.rigs.gatewayprocess import gateway_process
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.path.stored import StoredPaths
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.path import PathFlown, PathUploadRequest
from tests.client.fake import CLOCK, VEHICLE, fake_daemon
from tests.gateways.mavlink.test_links import free_port
from tests.gateways.programs import running
from tests.values import made

pytestmark = pytest.mark.gateways


@pytest.mark.timeout(600)
async def test_mission_raw_uploads_flies_pauses_and_goes_on():
    kept, stored, port = StoredPaths(AutopilotConfig()), [], free_port()
    async with fake_daemon() as daemon:

        def upload():
            request = PathUploadRequest.model_validate(daemon.asked[-1][1])
            stored.append(kept.upload(request, AircraftModel()))
            return dict(stored[-1])

        def fly():
            daemon.say(Phase.FLYING, "flies", manoeuvre="path")
            is_paused, path = daemon.setpoints[-1].get("paused", False), stored[-1]
            more = {"is_paused": is_paused, "progress": 0.75, "left": path.duration / 4, "rate": 1.0 - is_paused}
            daemon.bus.publish("control/path", made(PathFlown, CLOCK.stamp(), id=path.id, **more))

        daemon.replies["do/path_upload"], daemon.follow = upload, fly
        async with (
            gateway_process("mavlink", daemon.endpoint, VEHICLE, "--link", f"tcpin:127.0.0.1:{port}"),
            running(
                *("-m", "tests.gateways.mavlink.mavsdkpath", f"tcpout://127.0.0.1:{port}"),
                stdout=asyncio.subprocess.PIPE,
            ) as program,
        ):
            printed, _ = await asyncio.wait_for(program.communicate(), 400.0)
    found = [json.loads(line) for line in printed.splitlines() if line.startswith(b"{")]
    steps = ["refused"] * 3 + ["uploaded", "downloaded", "started", "paused", "continued", "progress"]
    assert [line["step"] for line in found] == steps
    assert [line["error"] for line in found[:3]] == ["INVALID_ARGUMENT", "UNSUPPORTED", "INVALID_ARGUMENT"]
    assert found[4]["same"] and (found[-1]["current"], found[-1]["total"]) == (2, 3)
    flown = [(fields.get("run"), fields.get("paused")) for fields in daemon.setpoints]
    assert [each for each, _ in groupby(flown)] == [(1, False), (1, True), (1, False)]
