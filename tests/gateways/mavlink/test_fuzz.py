"""Hostile ground stations: random bytes, and right messages of every kind with random fields; nothing happens."""

from __future__ import annotations

import asyncio
import random
import struct
import tracemalloc

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.mavlink.framing import Counts, Decoder, Encoder
from tests.gateways.mavlink.rig import WALL, Ears, FakeVehicle, serving, virtually

KINDS = tuple(sorted(mavlink.mavlink_map))
GROWTH = 2_000_000
"""Memory that may be held more at the end than in the middle [bytes]."""


COMMANDS = tuple(sorted(number for number in mavlink.enums["MAV_CMD"] if number < 65_536))


def meant_for_us(source, message):
    """A message, often with our number and with a command that exists."""
    for name, value in (("target_system", 1), ("target_component", 1), ("command", source.choice(COMMANDS))):
        if hasattr(message, name) and source.random() < 0.8:
            setattr(message, name, value)
    return message


def framed(kind, payload, seq):
    """A frame of MAVLink 2 with a right checksum."""
    made = mavlink.mavlink_map[kind]
    while len(payload) > 1 and payload[-1] == 0:
        payload = payload[:-1]
    head = struct.pack("<BBBBBBB", 0xFD, len(payload), 0, 0, seq % 256, 255, 190) + kind.to_bytes(3, "little")
    crc = mavlink.x25crc(head[1:] + payload + bytes([made.crc_extra]))
    return head + payload + struct.pack("<H", crc.crc)


async def storm(count, seed):
    """Send messages of every kind in turn; how memory grew from the middle on [bytes]."""
    source = random.Random(seed)
    vehicle = FakeVehicle()
    async with serving(vehicle) as gateway:
        ears = Ears(gateway)
        decoder = gateway.links.decoder()
        middle = 0
        tracemalloc.start()
        try:
            for number in range(count):
                kind = KINDS[number % len(KINDS)]
                payload = source.randbytes(mavlink.mavlink_map[kind].unpacker.size)
                found = decoder.datagram(framed(kind, payload, number), WALL)
                assert len(found) == 1, kind
                gateway.message_arrived(ears.station, meant_for_us(source, found[0]))
                if number % 50 == 0:
                    await asyncio.sleep(0.05)
                    ears.heard.clear()
                    vehicle.calls.clear()
                    vehicle.setpoints.clear()
                if number == count // 2:
                    middle = tracemalloc.get_traced_memory()[0]
            return tracemalloc.get_traced_memory()[0] - middle
        finally:
            tracemalloc.stop()


def garbage(count, seed):
    """Feed random bytes, right frames cut and changed among them; no more than a frame is kept."""
    source = random.Random(seed)
    decoder = Decoder(Counts(), None)
    encoder = Encoder(255, None)
    fed = 0
    while fed < count:
        data = source.randbytes(source.randrange(1, 400))
        if source.random() < 0.3:
            frame = bytearray(encoder.encode(mavlink.MAVLink_ping_message(1, 2, 3, 4), WALL))
            frame[source.randrange(len(frame))] ^= 1 << source.randrange(8)
            data = data[:50] + bytes(frame[: source.randrange(1, len(frame))]) + data[50:]
        for _ in decoder.feed(data, WALL):
            pass
        fed += len(data)
        assert len(decoder._rest) <= 280
    return decoder.counts


@pytest.mark.parametrize("count", [1000, pytest.param(100_000, marks=pytest.mark.gateways)])
@virtually
async def test_messages_of_every_kind_with_random_fields_leave_nothing_behind(count):
    assert await storm(count, 1) < GROWTH


@pytest.mark.parametrize("count", [10_000, pytest.param(1_000_000, marks=pytest.mark.gateways)])
def test_random_bytes_are_no_messages(count):
    assert garbage(count, 2).messages <= count // 500_000  # a checksum of 16 bits fits by chance
