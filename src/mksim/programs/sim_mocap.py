"""The simulated motion capture system on the bus: it reports as any localisation does, to `positions/<name>/report`."""

from __future__ import annotations

import asyncio

import zenoh

from mkdaemon.client.positions import PositionSender
from mkdaemon.client.transport import Transport
from mkdaemon.config.camera import read_image_secret
from mksim.config import SimConfig
from mksim.physics.mocap import RATE, Measured, MotionCapture
from mksim.simulation import Simulation


async def report_positions(session: zenoh.Session, simulation: Simulation, config: SimConfig, vehicle: str) -> None:
    """Report the aircraft at the rate of the system, with the fault `mocap` where it runs, until it is cancelled.

    Args:
        session: to the daemon.
        simulation: the aircraft.
        config: section of the system, and the seed of its noise.
        vehicle: name of the aircraft.

    Raises:
        ConfigError: the secret cannot be read.
    """
    section, loop = config.mocap, asyncio.get_running_loop()
    secret = None if section.secret_file is None else read_image_secret(section.secret_file)
    sender = PositionSender(Transport(session, vehicle, ""), section.name, secret)
    capture, faults, due = MotionCapture(config.seed), simulation.world.faults, loop.time()

    def report(measured: Measured) -> None:
        x, y, z = measured.position.tolist()
        sender.send((x, y, z), measured.quaternion, age=measured.stated)

    while True:
        capture.fault = faults.word("mocap", "kind") if faults.is_active("mocap") else ""
        measured = capture.measure(simulation.now, simulation.world.truth)
        if measured is not None:
            loop.call_later(measured.latency, report, measured)
        due = max(due + 1.0 / RATE, loop.time())
        await asyncio.sleep(due - loop.time())
