"""The program: addresses and options that a user gives, its key, and its mistakes in one line."""

from __future__ import annotations

import asyncio
import signal
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from mkdaemon.cli.interrupts import run_until_asked_to_end
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.gateways.boardset import backups_folder
from mkdaemon.gateways.mavlink.addresses import Address, AddressKind, check_addresses, read_address
from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.gateways.mavlink.program import options_from, serve
from tests.gateways.mavlink.rig import FakeVehicle
from tests.gateways.mavlink.test_links import free_port


def options(*links, system=1, key=None, allow_open=False):
    return options_from(links, system, key, None, allow_open=allow_open)


@pytest.mark.parametrize("system", [0, 251, -1])
def test_the_number_of_an_aircraft(system):
    with pytest.raises(ConfigError, match=f"--system {system}"):
        options(system=system)


def test_a_key_opens_a_network(tmp_path):
    key = tmp_path / "key"
    key.write_text("ab" * 32)
    assert options("udpin:0.0.0.0:14550", key=key).signing.key == bytes([0xAB]) * 32
    with pytest.raises(ConfigError, match="any program in that network"):
        options("udpin:0.0.0.0:14550")
    assert options("udpin:0.0.0.0:14550", allow_open=True).addresses


@pytest.mark.parametrize("content", [None, "", " \n", b"\xff\xfe"])
def test_a_key_that_cannot_be_used_is_one_line(tmp_path, content):
    key = tmp_path / "key"
    if content is not None:
        key.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ConfigError, match=r"--signing-key .*openssl rand"):
        options(key=key)


def test_where_settings_are_saved(monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/one:/var/lib/two")
    assert backups_folder("mavlink") == Path("/var/lib/one")
    monkeypatch.delenv("STATE_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", "/home/somebody/state")
    assert backups_folder("mavlink") == Path("/home/somebody/state/mkdaemon/gateway-mavlink")


@asynccontextmanager
async def open_fake():
    yield FakeVehicle()


async def test_it_serves_until_it_is_asked_to_end_or_a_link_cannot_be_opened():
    def ready():
        signal.raise_signal(signal.SIGTERM)

    async with asyncio.timeout(20.0):
        await run_until_asked_to_end(serve(open_fake, options(f"tcpin:127.0.0.1:{free_port()}"), ready))
    with pytest.raises(MkError, match=r"--link tcpin:203\.0\.113\.1:5760 cannot be opened"):
        await run_until_asked_to_end(serve(open_fake, options("tcpin:203.0.113.1:5760", allow_open=True), lambda: None))


async def test_it_waits_for_a_daemon_that_is_started_later(monkeypatch):
    monkeypatch.setattr("mkdaemon.gateways.mavlink.program._AGAIN", 0.01)
    ready, attempts = asyncio.Event(), []

    @asynccontextmanager
    async def open_vehicle():
        attempts.append(1)
        if len(attempts) < 3:
            raise MkError("no daemon answers")
        yield FakeVehicle()

    serving = asyncio.create_task(serve(open_vehicle, options(f"tcpin:127.0.0.1:{free_port()}"), ready.set))
    async with asyncio.timeout(20.0):
        await ready.wait()
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)
    assert len(attempts) == 3


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udpout:127.0.0.1:14550", Address(AddressKind.UDP_OUT, "127.0.0.1", 14550)),
        ("udpin:[::1]:14550", Address(AddressKind.UDP_IN, "::1", 14550)),
        ("tcpin:localhost:5760,ardupilot", Address(AddressKind.TCP_IN, "localhost", 5760, Numbering.ARDUPILOT)),
        ("tcpout:127.0.0.1:5790,as-px4", Address(AddressKind.TCP_OUT, "127.0.0.1", 5790, Numbering.AS_PX4)),
        ("serial:/dev/serial/by-id/usb-1:57600, px4", Address(AddressKind.SERIAL, "/dev/serial/by-id/usb-1", 57600)),
    ],
)
def test_addresses(text, address):
    assert read_address(text) == address
    assert address.is_local


@pytest.mark.parametrize(
    "text", ["", "udp:127.0.0.1:1", "udpin:127.0.0.1", "udpin::1", "tcpin:host:99999", "tcpin:host:0", "udpin:h:1,px5"]
)
def test_what_is_no_address(text):
    with pytest.raises(ConfigError, match="--link"):
        read_address(text)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "ground.example", "::"])
def test_a_network_needs_a_key_or_leave(host):
    address = (Address(AddressKind.UDP_IN, host, 14550),)
    with pytest.raises(ConfigError, match="any program in that network could fly"):
        check_addresses(address, has_key=False, allow_open=False)
    check_addresses(address, has_key=True, allow_open=False)
    check_addresses(address, has_key=False, allow_open=True)
