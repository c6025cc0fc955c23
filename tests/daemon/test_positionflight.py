"""The whole daemon takes off, holds and lands by signed reports of a motion capture system, without a camera.

In virtual time, on simulated boards; the physics is the judge.
"""

from __future__ import annotations

import asyncio
import math

from lab.rigs.linkrig import virtually
from mkdaemon.bus.codec import encode
from mkdaemon.config.positions import PositionSource
from mkdaemon.telemetry.setpoint import HoldSetpoint, LandSetpoint, TakeOffSetpoint
from mkdaemon.telemetry.signature import stamped_proof
from mkdaemon.telemetry.vision import EyeState
from mksim.physics.mocap import RATE, MotionCapture
from mksim.physics.world import World
from mksim.programs.rehearsal import simulated_aircraft
from mksim.programs.virtualdaemon import VirtualDaemon, virtual_config
from mksim.programs.virtualports import Cable, LocalBus
from mksim.simulation import Simulation

SECRET = "0123456789abcdef"
SUFFIX = "positions/mocap/report"
HEIGHT = 1.5


class Flight:
    """A daemon, its aircraft, and a system that reports it."""

    def __init__(self, folder):
        (folder / "secret").write_text(SECRET)
        source = PositionSource(name="mocap", target="room", secret_file=folder / "secret")
        config = simulated_aircraft(2, "indoor", 15.0)
        self.world = World(config.flight, seed=2)
        self.bus = LocalBus()
        line = Cable(Simulation(config, self.world), lambda now: None).open
        whole = virtual_config().model_copy(update={"positions": (source,)})
        self.daemon = VirtualDaemon(self.bus, line, config=whole)
        self.capture = MotionCapture(2)

    async def report(self):
        loop, sequence = asyncio.get_running_loop(), 0
        while True:
            measured = self.capture.measure(loop.time(), self.world.truth)
            sequence += 1
            if measured is not None:
                loop.call_later(measured.latency, self.put, measured.report(1, sequence))
            await asyncio.sleep(1.0 / RATE)

    def put(self, report):
        take, verify = self.bus.takers[SUFFIX]
        payload = encode(report)
        now = asyncio.get_running_loop().time()
        take(now, payload, verify(payload, stamped_proof(SECRET, SUFFIX, payload, now)))

    async def until(self, claim, within):
        loop = asyncio.get_running_loop()
        end = loop.time() + within
        while not claim():
            assert loop.time() < end, self.bus.values.get("control/status")
            await asyncio.sleep(0.02)

    async def stream(self, kind, seconds, fields, is_over=lambda status: False):
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds
        while loop.time() < end and not is_over(self.bus.values["control/status"]):
            self.bus.deliver(kind, loop.time(), *self.bus.sign_next(kind, fields))
            await asyncio.sleep(0.02)


@virtually
async def test_the_daemon_flies_by_motion_capture_from_take_off_to_landing(tmp_path):
    flight = Flight(tmp_path)
    flight.daemon.start()
    reporting = asyncio.create_task(flight.report())
    now, facts, link = asyncio.get_running_loop().time, flight.daemon.wiring.facts, flight.daemon.wiring.link
    try:
        await flight.until(lambda: link.is_up and link.dialect.extern_control and facts.motors_running(now()), 30.0)
        assert flight.bus.values["vision/mocap/stats"].state is EyeState.OK
        await flight.bus.take_lease("pilot")
        await flight.stream(TakeOffSetpoint, 20.0, {"height": HEIGHT, "target": "room"}, lambda status: status.is_done)
        assert flight.world.truth.position_enu[2] > HEIGHT - 0.2
        await flight.stream(HoldSetpoint, 3.0, {"target": "room"})
        x, y, z = flight.world.truth.position_enu
        assert math.hypot(x, y) < 0.1
        assert abs(z - HEIGHT) < 0.1
        await flight.stream(LandSetpoint, 30.0, {"target": "room"}, lambda status: status.lease is None)
    finally:
        reporting.cancel()
        await flight.daemon.stop()
    truth = flight.world.truth
    assert truth.on_ground
    assert not truth.crashed
    assert math.hypot(*truth.position_enu[:2]) < 0.1
    assert flight.bus.values["vision/mocap/stats"].refused == {}
