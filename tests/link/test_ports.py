"""Ports: pseudo terminals, TCP, recordings; and every mistake told in one line with its repair."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import json
import os
import socket
import sys
import termios
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from mkdaemon.errors import ConfigError, LinkError, LinkLostError
from mkdaemon.link.ports import serialport
from mkdaemon.link.ports.port import PortAddress, open_port, parse_address
from mkdaemon.link.ports.serialport import SerialPort, open_serial
from mkdaemon.link.ports.tcpport import OVERDUE

PATIENCE = 60.0
"""Longest wait for anything [s]; a loaded machine is slow, not wrong."""


async def arrived(near: int, size: int) -> bytes:
    """So many bytes from the near end: the kernel hands them over when it comes to it."""
    got = b""
    async with asyncio.timeout(PATIENCE):
        while len(got) < size:
            with contextlib.suppress(BlockingIOError):
                got += os.read(near, 4096)
            await asyncio.sleep(0)
    return got


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    near, far = os.openpty()
    tty.setraw(far)
    os.set_blocking(near, False)
    yield near, os.ttyname(far)
    for descriptor in (near, far):
        with contextlib.suppress(OSError):
            os.close(descriptor)


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("/dev/ttyUSB0", PortAddress("serial", "/dev/ttyUSB0")),
        ("/dev/serial/by-id/usb-FTDI:1", PortAddress("serial", "/dev/serial/by-id/usb-FTDI:1")),
        ("serial:/dev/ttyS1", PortAddress("serial", "/dev/ttyS1")),
        ("pty:/dev/pts/7", PortAddress("pty", "/dev/pts/7")),
        ("tcp:radio.local:2000", PortAddress("tcp", "radio.local:2000")),
        ("tcp:[::1]:2000", PortAddress("tcp", "[::1]:2000")),
        ("replay:a/b.jsonl", PortAddress("replay", "a/b.jsonl")),
        ("replay:b.jsonl?speed=20", PortAddress("replay", "b.jsonl", 20.0)),
    ],
)
def test_addresses(url: str, address: PortAddress):
    assert parse_address(url) == address


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("", "set link.port"),
        ("usb:0", "is not a port"),
        ("tcp:host", "tcp:host:port"),
        ("tcp:host:99999", "tcp:host:port"),
        ("pty:", "is not a port"),
        ("replay:f?speed=fast", "speed"),
        ("replay:f?speed=0", "speed"),
        ("replay:f?pace=2", "speed"),
    ],
)
def test_addresses_of_nothing_are_configuration_errors_in_one_line(url: str, words: str):
    with pytest.raises(ConfigError, match=words) as caught:
        parse_address(url)
    assert "\n" not in str(caught.value)


async def test_bytes_cross_a_pseudo_terminal_unchanged(terminal):
    near, name = terminal
    port = await open_port(f"pty:{name}")
    everything = bytes(range(256))
    os.write(near, everything)
    got = b""
    while len(got) < 256:
        got += await asyncio.wait_for(port.read(), PATIENCE)
    assert got == everything
    port.write(everything)
    await port.drain()
    assert await arrived(near, 256) == everything
    assert port.name == name
    assert not port.is_recording
    await port.close()
    await port.close()


async def test_several_chunks_before_a_read_come_as_one(terminal):
    near, name = terminal
    port = await open_port(f"pty:{name}")
    for part in (b"ab", b"cd"):
        os.write(near, part)
        before = sum(map(len, port._chunks))
        async with asyncio.timeout(PATIENCE):
            while sum(map(len, port._chunks)) < before + len(part):  # noqa: ASYNC110 - reading would take it
                await asyncio.sleep(0)
    assert await port.read() == b"abcd"
    await port.close()


async def test_the_terminal_is_raw_even_if_it_was_not(terminal):
    near, name = terminal
    far = os.open(name, os.O_RDWR | os.O_NOCTTY)
    cooked = termios.tcgetattr(far)
    cooked[0] |= termios.ICRNL | termios.IXON
    cooked[1] |= termios.OPOST | termios.ONLCR
    cooked[3] |= termios.ICANON | termios.ECHO
    termios.tcsetattr(far, termios.TCSANOW, cooked)
    port = await open_serial(Path(name), baud=57600)
    os.write(near, b"#av@w\r\n\x11\x13\x03")
    got = b""
    while len(got) < 10:
        got += await asyncio.wait_for(port.read(), PATIENCE)
    assert got == b"#av@w\r\n\x11\x13\x03"
    port.write(b"\r\n")
    await port.drain()
    assert await arrived(near, 2) == b"\r\n"
    await port.close()
    os.close(far)


async def test_an_unplugged_device_ends_reading_and_writing(terminal):
    near, name = terminal
    port = await open_port(f"pty:{name}")
    reading = asyncio.ensure_future(port.read())
    await asyncio.sleep(0)
    os.close(near)
    with pytest.raises(LinkLostError, match="unplugged"):
        await asyncio.wait_for(reading, PATIENCE)
    with pytest.raises(LinkLostError):
        port.write(b"#")
    with pytest.raises(LinkLostError):
        await port.drain()
    assert port.backlog == 0
    await port.close()


async def test_a_device_gone_during_a_write_is_told_apart_from_a_mistake(terminal, monkeypatch):
    _, name = terminal
    port = await open_port(f"pty:{name}")
    for number, words in ((28, "full"), (5, "unplugged"), (62, "the device failed")):
        port = port if number == 28 else await open_port(f"pty:{name}")

        def fail(descriptor: int, data: bytes, number: int = number) -> int:
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr(serialport.os, "write", fail)
        with pytest.raises(LinkLostError, match=words):
            port.write(b"#")
        with pytest.raises(LinkLostError, match=words):
            await port.read()
        monkeypatch.undo()
        await port.close()


async def test_a_device_that_takes_nothing_keeps_bytes_and_lets_go_at_once(terminal):
    _, name = terminal
    port = await open_port(f"pty:{name}")
    for _ in range(100):
        port.write(bytes(1000))
    await asyncio.sleep(0.01)
    assert port.backlog > 50_000
    await asyncio.wait_for(port.close(), PATIENCE)


async def test_a_port_has_a_descriptor_only_while_it_is_open(terminal):
    _, name = terminal
    assert SerialPort(name).descriptor is None
    before = descriptors()
    for _ in range(50):
        port = await open_port(f"pty:{name}")
        assert os.ttyname(port.descriptor) == name
        await port.close()
        assert port.descriptor is None
    assert descriptors() <= before + 1


async def test_draining_waits_for_a_device_that_takes_its_time(terminal):
    near, name = terminal
    port = await open_port(f"pty:{name}")
    size = 0
    while port.backlog < 10_000:
        port.write(bytes(1000))
        size += 1000
        await asyncio.sleep(0)
    draining = asyncio.create_task(port.drain())
    await asyncio.sleep(0.01)
    assert not draining.done()
    assert await arrived(near, size) == bytes(size)
    await asyncio.wait_for(draining, PATIENCE)
    await port.close()


async def test_what_was_written_before_closing_reaches_the_other_end(terminal):
    """A pseudo terminal throws away what its reader has not fetched when it is flushed: the end of a release."""
    near, name = terminal
    for _ in range(30):
        port = await open_port(f"pty:{name}", baud=57600)
        for _ in range(5):
            port.write(b"#bb=============Lo\r")
        await port.drain()
        await port.close()
        assert await arrived(near, 5 * 19) == b"#bb=============Lo\r" * 5


async def test_a_second_opener_is_told_who_has_the_port(terminal):
    _, name = terminal
    port = await open_port(f"pty:{name}")
    with pytest.raises(LinkError, match="is in use by"):
        await open_port(f"pty:{name}")
    await port.close()
    await (await open_port(f"pty:{name}")).close()


async def test_another_program_is_named(terminal):
    _, name = terminal
    code = (
        f"import fcntl, os, sys; f = os.open({name!r}, os.O_RDWR | os.O_NOCTTY); fcntl.flock(f, fcntl.LOCK_EX);"
        "print('ready', flush=True); sys.stdin.read()"
    )
    other = await asyncio.create_subprocess_exec(
        sys.executable, "-c", code, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    assert other.stdout is not None
    assert other.stdin is not None
    await other.stdout.readline()
    with pytest.raises(LinkError, match=rf"in use by python.* \(process {other.pid}\)"):
        await open_port(f"pty:{name}")
    other.stdin.close()
    await other.wait()


async def test_a_missing_device_says_what_is_there(tmp_path, monkeypatch):
    monkeypatch.setattr(serialport, "_BY_ID", tmp_path)
    with pytest.raises(LinkLostError, match="plug the adapter in"):
        await open_port("/dev/ttyUSB99")
    (tmp_path / "usb-FTDI_A1").touch()
    with pytest.raises(LinkLostError, match="usb-FTDI_A1"):
        await open_port("/dev/ttyUSB99")
    with pytest.raises(LinkLostError, match="mkdaemon sim"):
        await open_port("pty:/dev/pts/9999")


async def test_what_is_no_serial_device_is_a_port_that_may_still_come(tmp_path):
    plain, pipe = tmp_path / "plain", tmp_path / "pipe"
    plain.write_text("x")
    os.mkfifo(pipe)
    for path in (plain, pipe, tmp_path, Path("/dev/null")):
        with pytest.raises(LinkLostError, match="is not a serial device"):
            await open_port(str(path))
    assert plain.read_text() == "x"


async def test_no_permission_names_the_group(terminal, monkeypatch):
    _, name = terminal

    def refuse(*args: object, **options: object) -> serial.Serial:
        raise serial.SerialException(13, f"could not open port {name}: [Errno 13] Permission denied")

    monkeypatch.setattr(serialport.serial, "Serial", refuse)
    with pytest.raises(LinkError, match=r"no permission for .* group \w+; run: sudo usermod -aG"):
        await open_port(name)


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (serial.SerialException(5, "Input/output error"), LinkLostError, "its other end is not"),
        (serial.SerialException(99, "strange"), LinkError, "cannot be opened"),
        (ValueError("Not a valid baudrate"), ConfigError, "set link.baud"),
    ],
)
async def test_other_failures_are_one_line_each(terminal, monkeypatch, error, kind, words):
    _, name = terminal

    def fail(*args: object, **options: object) -> serial.Serial:
        raise error

    monkeypatch.setattr(serialport.serial, "Serial", fail)
    with pytest.raises(kind, match=words) as caught:
        await open_port(name)
    assert "\n" not in str(caught.value)


async def test_a_real_device_is_locked_against_programs_that_do_not_ask(terminal, monkeypatch):
    _, name = terminal
    asked: list[int] = []
    honest = fcntl.ioctl
    monkeypatch.setattr(
        serialport.fcntl, "ioctl", lambda fd, code, *rest: asked.append(code) or honest(fd, code, *rest)
    )
    await (await open_serial(Path(name), baud=57600)).close()
    assert termios.TIOCEXCL not in asked  # it would outlive a killed daemon on a pseudo terminal
    monkeypatch.setattr(Path, "resolve", lambda self: Path("/dev/ttyUSB0"))
    await (await open_serial(Path(name), baud=57600)).close()
    assert termios.TIOCEXCL in asked


def descriptors() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


async def test_tcp_both_ways_and_its_end():
    arrived: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        arrived.set_result(await reader.read(64))
        writer.write(b"#cZ")
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    number = server.sockets[0].getsockname()[1]
    port = await open_port(f"tcp:127.0.0.1:{number}")
    assert port.backlog == 0
    assert not port.is_recording
    port.write(b"#av@w\r")
    await port.drain()
    assert await arrived == b"#av@w\r"
    assert await port.read() == b"#cZ"
    with pytest.raises(LinkLostError, match="closed the connection"):
        await port.read()
    await port.close()
    with pytest.raises(LinkLostError):
        port.write(b"#")
    with pytest.raises(LinkLostError):
        await port.drain()
    server.close()
    await server.wait_closed()


async def test_what_a_device_has_not_taken_can_be_thrown_away(terminal, monkeypatch):
    _, name = terminal
    port = await open_port(f"pty:{name}")
    flushed = []
    monkeypatch.setattr(port._transport.serial, "reset_output_buffer", lambda: flushed.append(True))
    port.write(b"x" * 100_000)
    assert port.backlog > 0
    port.discard()
    assert port.backlog == 0
    assert flushed == [True]
    await port.close()
    port.discard()


async def test_a_tcp_connection_that_stands_still_is_told_and_ended_with_what_waits_in_it():
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        server.bind(("127.0.0.1", 0))
        server.listen(1)
        port = await open_port(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        peer, _ = server.accept()
        port.write(b"x" * 20_000)
        assert port.backlog < 20_000, "nothing is overdue yet"
        await asyncio.sleep(2 * OVERDUE)
        assert port.backlog > 0
        with pytest.raises(LinkLostError, match="stalled"):
            port.discard()
        await port.close()
        with peer, pytest.raises(ConnectionResetError):
            while peer.recv(4096):
                pass


async def test_draining_waits_for_a_tcp_connection_that_takes_its_time():
    loop = asyncio.get_running_loop()
    connected: asyncio.Future[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = loop.create_future()
    server = await asyncio.start_server(lambda *both: connected.set_result(both), "127.0.0.1", 0, limit=1024)
    port = await open_port(f"tcp:127.0.0.1:{server.sockets[0].getsockname()[1]}")
    (reader, writer), size = await connected, 0
    while not port.backlog:
        port.write(bytes(100_000))
        size += 100_000
        await asyncio.sleep(0.01)  # what is still on its way to the receiver's kernel is no backlog
    draining = asyncio.create_task(port.drain())
    await asyncio.sleep(0.01)
    assert not draining.done()
    await asyncio.wait_for(reader.readexactly(size), PATIENCE)
    await asyncio.wait_for(draining, PATIENCE)
    await port.close()
    writer.close()
    await writer.wait_closed()
    server.close()


async def test_tcp_mistakes(monkeypatch):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        with pytest.raises(LinkLostError, match="is the serial server running"):
            await open_port(f"tcp:127.0.0.1:{unused.getsockname()[1]}")

    def nowhere(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", nowhere)  # a machine without a network would wait for its resolver
    with pytest.raises(LinkError, match="no host"):
        await open_port("tcp:no.such.host.invalid:2000")


async def test_a_recording_keeps_its_timing(tmp_path):
    chunks = [(0.0, b"a"), (0.4, b"b"), (0.5, b""), (1.0, b"c")]  # a chunk of nothing is not the end
    lines = [json.dumps({"t": 1.8e9 + t, "dir": "rx", "hex": raw.hex()}) for t, raw in chunks]  # Unix time will do
    lines.insert(1, json.dumps({"t": 1.8e9 + 0.1, "dir": "tx", "hex": "00"}))
    path = tmp_path / "session.jsonl"
    path.write_text("\n".join([*lines, ""]))
    port = await open_port(f"replay:{path}?speed=10")
    port.write(b"never leaves")
    await port.drain()
    loop = asyncio.get_running_loop()
    began, got = loop.time(), []
    while chunk := await port.read():
        got.append((chunk, loop.time() - began))
    assert [chunk for chunk, _ in got] == [b"a", b"b", b"c"]
    for (_, at), (t, _) in zip(got, (c for c in chunks if c[1]), strict=True):
        assert at >= t / 10 - 1e-3
    assert await port.read() == b""
    assert (port.name, port.backlog, port.is_recording) == (str(path), 0, True)
    await port.close()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("#bv@x\r", "raw bytes tell no times"),
        ('{"t": 0, "dir": "rx", "hex": ""}', "nothing in it"),
        ('{"t": 0, "dir": "tx", "hex": "00"}', "nothing in it"),
        ("not json", "raw bytes"),
        ('{"t": 0, "dir": "rx", "hex": "00"}\nnot json', "line 2"),
        ('{"t": 0, "dir": "rx", "hex": "zz"}', "line 1"),
        ('{"t": 0, "hex": "00"}', "line 1"),
        ("{}", "line 1"),
        ("\xff\xfe\x00", "raw bytes tell no times"),
    ],
)
async def test_broken_recordings_name_the_line(tmp_path, text, words):
    path = tmp_path / "x.jsonl"
    with pytest.raises(ConfigError, match="name an existing recording"):
        await open_port(f"replay:{path}")
    path.write_text(text, encoding="latin-1")
    with pytest.raises(ConfigError, match=words):
        await open_port(f"replay:{path}")
