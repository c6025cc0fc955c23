"""UDP, TCP and serial on this machine, with pymavlink's own connections at the other end."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from contextlib import AsyncExitStack, asynccontextmanager

import pytest
from pymavlink.dialects.v20 import all as mavlink

from lab.rigs.waiting import wait_for
from mkdaemon.gateways.mavlink.addresses import Address, AddressKind
from mkdaemon.gateways.mavlink.framing import Encoder
from mkdaemon.gateways.mavlink.links import MOST_STATIONS, Links
from mkdaemon.gateways.mavlink.stations import Program

BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
PING = mavlink.MAVLink_ping_message(1, 2, 0, 0)


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@asynccontextmanager
async def linked(*addresses):
    """Links that are open, and what came over them."""
    came = []

    def take(station, message):
        station.note_message(Program(message.get_srcSystem(), 1), time.monotonic(), is_heartbeat=True)
        came.append((station, message.get_type()))

    links = Links(1, None, take, time.monotonic, time.time)
    async with asyncio.TaskGroup() as tasks:
        try:
            for address in addresses:
                await links.open(address, tasks)
            yield links, came
        finally:
            links.close()
            for task in asyncio.all_tasks() - {asyncio.current_task()}:
                if task.get_name().startswith("line "):
                    task.cancel()


@asynccontextmanager
async def listening(kind):
    """Links that listen; what came over them, and their port."""
    port = free_port(socket.SOCK_DGRAM if kind is AddressKind.UDP_IN else socket.SOCK_STREAM)
    async with linked(Address(kind, "127.0.0.1", port)) as (links, came):
        yield links, came, port


def bytes_of(message, system=255):
    return Encoder(system, None).encode(message, time.time())


async def test_a_program_that_listens_is_found_and_missed():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.bind(("127.0.0.1", 0))
        program.setblocking(False)
        loop = asyncio.get_running_loop()
        async with linked(Address(AddressKind.UDP_OUT, "127.0.0.1", program.getsockname()[1])) as (links, came):
            (station,) = links.stations
            assert not station.is_present(time.monotonic())
            station.send(BEAT)
            data, sender = await loop.sock_recvfrom(program, 300)
            assert data[0] == 0xFD
            program.sendto(bytes_of(BEAT), sender)
            await wait_for(lambda: came)
            now = time.monotonic()
            assert station.is_present(now) and station.is_alive(Program(255, 1), now)
            program.close()  # killed: the machine says at once that nobody listens, and no silence has to tell it
            await wait_for(lambda: station.send(BEAT) or not station.is_alive(Program(255, 1), now))


async def test_each_address_that_sends_is_a_station():
    async with AsyncExitStack() as stack:
        links, came, port = await stack.enter_async_context(listening(AddressKind.UDP_IN))
        ends = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(MOST_STATIONS + 1))
        programs = [stack.enter_context(end) for end in ends]
        for program in programs:
            program.setblocking(False)
            program.sendto(b"\xfd nonsense", ("127.0.0.1", port))
            program.sendto(bytes_of(BEAT), ("127.0.0.1", port))
        await wait_for(lambda: links.counts.messages == len(programs))  # the last one's is read, too, and refused
        assert len(came) == len(links.stations) == MOST_STATIONS
        for station in links.stations:
            station.send(PING)
        data = await asyncio.get_running_loop().sock_recv(programs[0], 300)
        assert data[7] == mavlink.MAVLINK_MSG_ID_PING


async def test_connections_are_stations_while_they_stand():
    async with listening(AddressKind.TCP_IN) as (links, came, port):
        ends = [await asyncio.open_connection("127.0.0.1", port) for _ in range(MOST_STATIONS)]
        await wait_for(lambda: len(links.stations) == MOST_STATIONS)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        assert await reader.read() == b""  # one too many
        writer.close()
        reader, writer = ends[0]
        whole = bytes_of(BEAT)
        writer.write(whole[:5])
        await writer.drain()
        await asyncio.sleep(0)
        writer.write(whole[5:])
        await wait_for(lambda: came)
        came[0][0].send(PING)
        assert (await reader.readexactly(10))[7] == mavlink.MAVLINK_MSG_ID_PING
        for _, one in ends:
            one.close()
        await wait_for(lambda: not links.stations)
        assert not came[0][0].is_open


async def test_a_station_that_does_not_read_loses_messages_and_holds_nobody_up():
    async with listening(AddressKind.TCP_IN) as (links, _, port):
        _, writer = await asyncio.open_connection("127.0.0.1", port, limit=1)
        await wait_for(lambda: links.stations)
        (station,) = links.stations
        text = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [7] * 251)
        for _ in range(60_000):
            station.send(text)
            if station.dropped:
                break
        assert station.dropped
        writer.close()


async def test_a_script_that_is_restarted_again_and_again_finds_room(monkeypatch):
    """Each start comes from a port of its own; the tenth within half a minute got no answer, and the log no line."""
    monkeypatch.setattr("mkdaemon.gateways.mavlink.links.SILENCE", 0.05)
    async with listening(AddressKind.UDP_IN) as (links, came, port):
        for start in range(MOST_STATIONS + 4):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as script:
                script.sendto(bytes_of(BEAT), ("127.0.0.1", port))
                await wait_for(lambda start=start: len(came) == start + 1)
            await asyncio.sleep(0.06)
        assert len(links.stations) <= MOST_STATIONS


@pytest.mark.parametrize("head", [b"POST / HTTP/1.1\r\nHost: x\r\n\r\n", b"\x16\x03\x01", b"SSH-2.0-x\r\n"])
async def test_a_connection_that_begins_as_something_else_is_closed_and_not_read(head):
    """What a web page posts holds the bytes that it wants; PARAM_SET reached a board so."""
    write = mavlink.MAVLink_param_set_message(1, 1, b"GYRO_P", 55.0, 9)
    async with listening(AddressKind.TCP_IN) as (links, came, port):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(head + bytes_of(write))
        assert await reader.read() == b""
        assert not came and not links.stations
        writer.close()


async def test_a_serial_line_is_opened_again():
    first, second = os.openpty()
    async with linked(Address(AddressKind.SERIAL, os.ttyname(second), 57_600)) as (links, came):
        await wait_for(lambda: links.stations)
        os.write(first, bytes_of(BEAT))
        await wait_for(lambda: came)
        links.stations[0].send(PING)
        data = await asyncio.get_running_loop().run_in_executor(None, os.read, first, 300)
        assert data[7] == mavlink.MAVLINK_MSG_ID_PING
    os.close(first)
    os.close(second)


async def test_a_program_that_listens_for_tcp_is_connected_to_again_and_again():
    port, heard = free_port(), []

    async def talk(reader, writer):
        heard.append(await reader.read(1))
        writer.write(bytes_of(BEAT))
        await writer.drain()
        writer.close()

    async with linked(Address(AddressKind.TCP_OUT, "127.0.0.1", port)) as (links, came):
        await asyncio.sleep(0.1)
        assert not links.stations  # nobody listens yet
        server = await asyncio.start_server(talk, "127.0.0.1", port)
        async with server:
            for times in (1, 2):
                await wait_for(lambda: links.stations, 5.0, 0.01)
                links.stations[0].send(BEAT)
                await wait_for(lambda times=times: len(came) == times, 5.0)
                await wait_for(lambda: not links.stations)
    assert heard == [b"\xfd", b"\xfd"] and came[0][0].name == f"tcpout:127.0.0.1:{port}"
