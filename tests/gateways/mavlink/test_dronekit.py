"""DroneKit before the simulated boards: `make check-gateways`. Its link has ArduPilot's numbers."""

from __future__ import annotations

import asyncio
import json

import pytest

from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.overtarget import VEHICLE, Setting, over_target
from tests.gateways.mavlink.test_links import free_port
from tests.gateways.programs import running

pytestmark = [pytest.mark.gateways, pytest.mark.flight]


@pytest.mark.timeout(600)
async def test_it_connects_and_stores_a_mission(tmp_path):
    """It hung at an empty list, which it asks for item 0, and at an upload, for it answers MISSION_REQUEST alone."""
    port = free_port()
    link = f"tcpin:127.0.0.1:{port},ardupilot"
    dronekit = ("-m", "tests.gateways.mavlink.dronekitprogram", f"tcp:127.0.0.1:{port}")
    async with (
        over_target(Setting(fps=5.0, wind="none", pilot="nothing")) as rig,
        gateway_process("mavlink", rig.endpoint, VEHICLE, "--link", link, "--backups", str(tmp_path)),
        running(*dronekit, stdout=asyncio.subprocess.PIPE) as process,
        asyncio.timeout(240.0),
    ):
        said, _ = await process.communicate()
    found = json.loads(said.splitlines()[-1])
    assert found["mode"] == "STABILIZE" and found["empty"] == []
    assert len(found["stored"]) == 2
    for place, latitude in zip(found["stored"], (53.2302, 53.2303), strict=True):
        assert place == pytest.approx([latitude, 7.4591, 10.0], abs=5e-6)  # MISSION_ITEM has floats of 32 bits
