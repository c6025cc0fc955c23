"""MAVSDK before the simulated aircraft, everything in processes of its own: `make check-gateways`."""

from __future__ import annotations

import asyncio
import json
import signal
import time
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from lab.rigs.gatewayprocess import gateway_process
from lab.rigs.overtarget import VEHICLE, Setting, favour, hovering, over_target
from lab.rigs.waiting import wait_for
from tests.gateways.mavlink.test_links import free_port
from tests.gateways.programs import running

pytestmark = [pytest.mark.gateways, pytest.mark.flight]
RELEASED = 1.1
"""From the last setpoint to the release [s]; docs/safety.md says 1.0."""


class Program:
    """A MAVSDK program that runs, and what it has printed."""

    def __init__(self, process):
        self.process, self.lines = process, []
        self._reading = asyncio.create_task(self._read())

    async def _read(self):
        while line := await self.process.stdout.readline():
            if line.startswith(b"{"):
                self.lines.append(json.loads(line))

    def found(self, step):
        """What was printed of a step."""
        return next((line for line in self.lines if line["step"] == step), None)

    async def done(self, step, within):
        """Wait for a step, and fail where it did."""
        await wait_for(lambda: self.found(step) or self.process.returncode is not None, within, 0.02)
        found = self.found(step)
        assert found is not None and "error" not in found, self.lines
        return found

    async def end(self):
        await asyncio.gather(self.process.wait(), self._reading)


@asynccontextmanager
async def mavsdk(port, *steps):
    """Run a program through some steps."""
    arguments = ("-m", "tests.gateways.mavlink.mavsdkprogram", f"tcpout://127.0.0.1:{port}", *steps)
    async with AsyncExitStack() as stack:
        process = await stack.enter_async_context(running(*arguments, stdout=asyncio.subprocess.PIPE))
        program = Program(process)
        stack.push_async_callback(program.end)
        stack.callback(lambda: process.returncode is None and process.kill())
        yield program


@asynccontextmanager
async def flown(rig):
    """A gateway beside a daemon; the port at which it is reached."""
    favour(rig.daemon.pid)  # what is looked at is the gateway: a busy machine says nothing of it
    port = free_port()
    async with gateway_process("mavlink", rig.endpoint, VEHICLE, "--link", f"tcpin:127.0.0.1:{port}"):
        yield port


@pytest.mark.timeout(600)
async def test_it_subscribes_stores_a_mission_flies_a_stream_and_is_killed():
    async with hovering(Setting(fps=12.0, wind="none", is_tapped=True)) as rig, flown(rig) as port:
        steps = ("subscribe", "metadata", "mission", "offboard", "north=0.4", "wait=600")
        async with mavsdk(port, *steps) as program:
            assert (await program.done("connected", 60.0))["autopilot"] == 3
            seen = await program.done("subscribe", 90.0)
            assert seen["flight_mode"] and "nan" not in seen["position"]
            help_for = (await program.done("metadata", 90.0))["parameters"]
            assert len(help_for) > 100 and help_for["GYRO_P"]
            stored = await program.done("mission", 60.0)
            assert (stored["same"], stored["count"], stored["refused"]) == (True, 4, "UNSUPPORTED")
            assert any("carry no speed" in line.get("text", "") for line in program.lines)
            await program.done("offboard", 60.0)
            await program.done("north=0.4", 60.0)
            killed = time.monotonic()
            program.process.send_signal(signal.SIGKILL)
            await wait_for(lambda: rig.seen.phases[-1].startswith("free"), 10.0, 0.01)
        await asyncio.sleep(0.5)
    releases = [at for at, frame in rig.tap.sticks() if at > killed and not frame.config]
    assert releases and releases[0] - killed <= RELEASED


async def fly(rig, port, steps):
    """Let a program fly some steps, each with its longest time, the last of which is a landing on the pad."""
    async with mavsdk(port, *steps, "land", "ground") as program:
        for step, within in (steps | {"land": 30.0, "ground": 90.0}).items():
            await program.done(step, within)
        await program.end()
    await wait_for(lambda: rig.seen.phases[-1].startswith("free"), 10.0, 0.05)
    assert rig.seen.last["control/status"]["outcome"] == "landed"
    east, north, _ = rig.seen.last["sim/truth"]["position_enu"]
    assert abs(east) < 0.15 and abs(north) < 0.15


@pytest.mark.timeout(600)
async def test_it_goes_to_a_point_and_lands_on_the_pad():
    async with hovering(Setting(fps=12.0, wind="none")) as rig, flown(rig) as port:
        await fly(rig, port, {"offboard": 60.0, "north=0.4": 40.0, "north=0.0": 40.0, "stop": 30.0})


@pytest.mark.timeout(600)
async def test_it_takes_off_and_lands_on_the_pad():
    """A take-off that no image shows within 1.2 s is ended by the daemon: it needs a machine that has time."""
    async with over_target(Setting(fps=10.0, wind="none", pilot="start")) as rig, flown(rig) as port:
        await rig.client.state.flight.until(lambda now: bool(now.motors_running), patience=120.0)
        await fly(rig, port, {"health": 60.0, "arm": 90.0, "takeoff": 60.0, "height=1.8": 60.0})
