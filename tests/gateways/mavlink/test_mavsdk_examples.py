"""MAVSDK's own example programs, unchanged, before the simulated aircraft: `make check-gateways`.

No wheel of MAVSDK brings its examples, and nothing is fetched here, so a folder of them is given:
`MAVSDK_EXAMPLES=.../MAVSDK-Python/examples MAVSDK_PYTHON=.../bin/python make check-gateways`, the second an interpreter
with the release that they are for (`pip install 'mavsdk<4'`); the tests of test_mavsdk.py make the same calls in the
same order without them. The examples listen at UDP 14540, and their aircraft is a PX4 that flies by GPS: what a
MikroKopter does otherwise is said in each test.
"""

from __future__ import annotations

import asyncio
import os
import sys
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.overtarget import VEHICLE, Setting, favour, hovering, over_target
from lab.rigs.waiting import wait_for

FOLDER = os.environ.get("MAVSDK_EXAMPLES", "")
PYTHON = os.environ.get("MAVSDK_PYTHON", sys.executable)
pytestmark = [
    pytest.mark.gateways,
    pytest.mark.flight,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not FOLDER, reason="MAVSDK_EXAMPLES names no folder of examples"),
]
LINK = "udpout:127.0.0.1:14540"


class Example:
    """An example that runs, and what it has printed."""

    def __init__(self, process):
        self.process, self.said = process, ""
        self._reading = asyncio.create_task(self._read())

    async def _read(self):
        while data := await self.process.stdout.read(4096):
            self.said += data.decode(errors="replace")

    async def says(self, words, within=90.0):
        """Wait for words."""
        await wait_for(lambda: words in self.said or self.process.returncode is not None, within, 0.05)
        assert words in self.said, self.said

    async def ends(self, within=120.0):
        """Wait for its end, which is no fault."""
        await wait_for(lambda: self.process.returncode is not None, within, 0.05)
        await self._reading
        assert self.process.returncode == 0 and "Traceback" not in self.said, self.said


@asynccontextmanager
async def example(rig, name, tmp_path):
    """An example and the gateway that it meets."""
    favour(rig.daemon.pid)
    async with gateway_process("mavlink", rig.endpoint, VEHICLE, "--link", LINK, "--backups", str(tmp_path)):
        process = await asyncio.create_subprocess_exec(
            *(PYTHON, "-u", str(Path(FOLDER) / name)),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            start_new_session=True,
        )
        favour(process.pid)
        running = Example(process)
        try:
            yield running
        finally:
            sys.stderr.write(running.said)
            if process.returncode is None:
                process.kill()
                await process.wait()


async def test_takeoff_and_land(tmp_path):
    """It waits for a global position, arms (the pilot has started the motors), takes off over the target and lands."""
    async with over_target(Setting(fps=10.0, wind="none", pilot="start")) as rig:
        await rig.client.state.flight.until(lambda now: bool(now.motors_running), patience=120.0)
        async with example(rig, "takeoff_and_land.py", tmp_path) as program:
            await program.says("Global position estimate OK")
            await program.says("-- Landing", 120.0)
            await program.ends()
            await wait_for(lambda: (rig.seen.last["control/status"] or {}).get("outcome") == "landed", 60.0, 0.05)


async def test_telemetry(tmp_path):
    """It prints battery, GPS, position and whether it is in the air, for ever."""
    setting = Setting(fps=5.0, wind="none", pilot="nothing")
    async with over_target(setting) as rig, example(rig, "telemetry.py", tmp_path) as program:
        for words in ("Battery: ", "FIX_3D", "In air: False", "latitude_deg: 53.2"):
            await program.says(words)
        assert "Traceback" not in program.said


async def test_offboard_position(tmp_path):
    """It flies a stream of places of the local frame; the second is 5 m aside, where no camera sees the target.

    What follows is the daemon's: the program goes on, and the pilot has the aircraft.
    """
    async with hovering(Setting(fps=12.0, wind="none")) as rig:
        async with example(rig, "offboard_position_ned.py", tmp_path) as program:
            await program.says("-- Go 0m North, 0m East, -5m Down")
            await wait_for(lambda: rig.seen.is_flying, 30.0, 0.05)
            await program.ends()
        await wait_for(lambda: not rig.seen.is_flying, 30.0, 0.05)


async def test_mission(tmp_path):
    """Its points are in Zurich, with a speed that the list of this NaviCtrl 0.24 has not: the upload is refused."""
    setting = Setting(fps=5.0, wind="none", pilot="nothing")
    async with over_target(setting) as rig, example(rig, "mission.py", tmp_path) as program:
        await program.says("-- Uploading mission")
        await program.says("mission.MissionError: ")
