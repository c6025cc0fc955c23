"""MAVProxy in a terminal, and DroneKit, before the simulated boards: `make check-gateways`, ArduPilot's numbers."""

from __future__ import annotations

import asyncio
import json
import os
import re
import sys
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.overtarget import VEHICLE, Setting, over_target
from lab.rigs.waiting import wait_for
from tests.gateways.mavlink.test_links import free_port
from tests.gateways.programs import running

pytestmark = [pytest.mark.gateways, pytest.mark.flight]
MAVPROXY = Path(sys.executable).with_name("mavproxy.py")
WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t53.2301184\t7.4590749\t0\t1
1\t0\t3\t16\t2\t5\t0\t0\t53.2302184\t7.4591749\t10\t1
2\t0\t3\t16\t0\t5\t0\t0\t53.2303184\t7.4590749\t12\t1
"""
ENDS = ("stdin", "stdout", "stderr")
TAKE_OFF = WAYPOINTS.replace("\t16\t2\t", "\t22\t0\t")


class Terminal:
    """MAVProxy at work, and what stands on its terminal."""

    def __init__(self, process, end):
        self.process, self._end, self.text = process, end, ""
        asyncio.get_running_loop().add_reader(end, self._read)

    def _read(self):
        try:
            self.text += os.read(self._end, 65536).decode(errors="replace")
        except OSError:
            asyncio.get_running_loop().remove_reader(self._end)

    async def type(self, line, *answers, within=60.0):
        """Type a line and wait for what is to appear behind it; what appeared."""
        start = len(self.text)
        os.write(self._end, line.encode() + b"\n")
        for answer in answers:
            await wait_for(lambda answer=answer: re.search(answer, self.text[start:]), within, 0.05)
        return self.text[start:]


@asynccontextmanager
async def mavproxy(port, folder):
    """MAVProxy, connected."""
    first, second = os.openpty()
    arguments = (str(MAVPROXY), f"--master=tcp:127.0.0.1:{port}", f"--state-basedir={folder}", "--nowait")
    modules, ends = "--default-modules=cmdlong,mode,param,rc,wp,arm,misc,fence", dict.fromkeys(ENDS, second)
    environment = {**os.environ, "HOME": str(folder), "TERM": "dumb"}
    try:
        async with running(*arguments, modules, cwd=folder, env=environment, **ends) as process:
            yield Terminal(process, first)
    finally:
        asyncio.get_running_loop().remove_reader(first)
        os.close(first)
        os.close(second)


@pytest.mark.timeout(600)
async def test_its_commands_do_what_they_do_on_ardupilot(tmp_path):
    assert MAVPROXY.exists(), "pip install -r tests/gateways/mavlink/clients.txt --no-deps"
    (tmp_path / "way.txt").write_text(WAYPOINTS)
    (tmp_path / "takeoff.txt").write_text(TAKE_OFF)
    port = free_port()
    link = f"tcpin:127.0.0.1:{port},ardupilot"
    async with (
        over_target(Setting(fps=5.0, wind="none", pilot="nothing")) as rig,
        gateway_process("mavlink", rig.endpoint, VEHICLE, "--link", link, "--backups", str(tmp_path / "backups")),
        mavproxy(port, tmp_path) as terminal,
    ):
        await wait_for(lambda: "STABILIZE" in terminal.text, 90.0, 0.1)
        await terminal.type("param fetch", r"Received \d+ parameters", within=120.0)
        shown = await terminal.type("param show GYRO_P", r"GYRO_P +\d+")
        assert "GYRO_P" in shown
        await terminal.type("wp load way.txt", r"Loaded 3 waypoints", r"Sent all 3 waypoints", within=120.0)
        listed = await terminal.type("wp list", r"Saved 3 waypoints|Requesting 3 waypoints", r"53\.230318")
        assert "53.230218" in listed
        await terminal.type("wp load takeoff.txt", r"Loaded 3 waypoints", r"Sent all 3 waypoints", within=120.0)
        assert "fence breach" not in terminal.text
        await terminal.type("mode GUIDED", r"Offboard flies a stream of setpoints")
        await terminal.type("mode ALT_HOLD", r"a switch of the pilot's transmitter|a switch of")
        await terminal.type("arm throttle", r"the pilot starts and stops the motors")
        await terminal.type("status", r"BATTERY_STATUS", r"GPS_RAW_INT", r"SYS_STATUS")
        await terminal.type("rc 3 1200")
        await terminal.type("mode STABILIZE")
        await wait_for(lambda: rig.seen.is_flying, 60.0, 0.05)
        sent = (await rig.client.get("control/output")).fields
        assert (sent["pitch"], sent["roll"], sent["yaw"]) == (0, 0, 0)
        await terminal.type("rc all 0")
        await wait_for(lambda: not rig.seen.is_flying, 60.0, 0.05)
        assert terminal.process.returncode is None


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
