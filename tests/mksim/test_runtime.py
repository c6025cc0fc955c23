"""Real time and ports around the simulation, with a clock of our own where time matters."""

from __future__ import annotations

import asyncio
import os

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mksim.boards.line import HOST_CHAR
from mksim.config import ChannelConfig, PilotPlan, RadioConfig, SimConfig
from mksim.runtime import Runtime
from mksim.simulation import Simulation
from tests.bus.support import PATIENCE, free_endpoint

WIRED = RadioConfig(to_host=ChannelConfig())
ECHO = encode_frame(2, "z", b"\x34\x12")


def free_port():
    return int(free_endpoint().rpartition(":")[2])


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def quiet(**options):
    return Simulation(SimConfig(pilot_plan=PilotPlan.NOTHING, radio=WIRED, **options))


def test_no_byte_comes_out_before_its_wire_time():
    clock = Clock()
    runtime = Runtime(quiet(), clock=clock)
    descriptor = os.open(runtime.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        for _ in range(50):
            clock.now += 1e-3
            runtime._step()
        os.write(descriptor, ECHO)
        runtime._take_terminal()
        sent, seen = clock.now, []
        for _ in range(80):
            clock.now += 0.1e-3
            runtime._step()
            try:
                seen += [clock.now] * len(os.read(descriptor, 64))
            except BlockingIOError:
                continue
    finally:
        os.close(descriptor)
        runtime._terminal.close()
    # ten characters in, the FIFO's time-out, ten characters out
    earliest = sent + 10 * HOST_CHAR + 0.56e-3
    assert len(seen) == 10
    for number, at in enumerate(seen, 1):
        assert earliest + number * HOST_CHAR <= at <= earliest + number * HOST_CHAR + 0.35e-3


async def ask(reader, writer, request, letter):
    writer.write(request)
    decoder = FrameDecoder()
    async with asyncio.timeout(PATIENCE):
        while data := await reader.read(256):
            for item in decoder.feed(data):
                if isinstance(item, Frame) and item.id == letter:
                    return item
    return None


async def test_tcp_carries_one_client_at_a_time():
    port = free_port()
    runtime = Runtime(quiet(), listen=f"127.0.0.1:{port}")
    async with runtime.serve():
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        heard = await ask(reader, writer, ECHO, "Z")
        assert heard.payload[:2] == b"\x34\x12"
        second, other = await asyncio.open_connection("127.0.0.1", port)
        async with asyncio.timeout(PATIENCE):
            assert await second.read(10) == b""
        other.close()
        writer.close()
        await writer.wait_closed()
        async with asyncio.timeout(PATIENCE):
            while True:
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                heard = await ask(reader, writer, ECHO, "Z")  # None where the first client is still being let go of
                writer.close()
                if heard is not None:
                    break
                await asyncio.sleep(0.02)


async def test_a_simulation_that_fails_is_noticed_and_named():
    runtime = Runtime(quiet())

    def fail(to):
        raise ConfigError("sim.eeprom fc.json: No space left on device")

    with pytest.raises(ConfigError, match="No space left"):
        async with runtime.serve(), asyncio.timeout(10):
            runtime.simulation.advance = fail
            await runtime.ended.wait()
